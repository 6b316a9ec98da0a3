"""udsoncan and can-isotp on simbus: the example's session."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("udsoncan", reason="needs udsoncan")
pytest.importorskip("isotp", reason="needs can-isotp")
ROOT = Path(__file__).parents[4]


def test_the_example_reads_and_clears_fault_codes():
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "uds" / "session.py"],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].startswith("22: session 1, calibration ")
    assert lines[1].startswith("19 02: 5A") and lines[1].endswith("00, status 0B")
    assert lines[2] == "19 04: time, speed, roll rate, lateral acceleration"
    assert lines[3:] == ["14: ServiceNotSupportedInActiveSession", "10 03, 14: cleared"]
    page = (ROOT / "docs" / "services.md").read_text(encoding="utf-8")
    # the id is that of a random calibration
    assert all(f"\n{line}\n" in page for line in lines[1:])
