"""An exported bundle's own build."""

import subprocess
from pathlib import Path


def make(folder: Path, *goals: str) -> "subprocess.CompletedProcess[str]":
    """Run ``make`` in the folder of a bundle; goals may be variables as well."""
    command = ["make", "-C", str(folder), *goals]
    return subprocess.run(command, capture_output=True, text=True, timeout=1800, check=False)
