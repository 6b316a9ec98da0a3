"""What the README shows is what its commands print."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_readme_shows_what_its_commands_print():
    done = subprocess.run(
        [ROOT / "scripts" / "refresh-docs", "--check", ROOT / "README.md"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
