"""A benchmark's ratio that has become more than 10 % worse than the committed one is noticed."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts" / "ratios"
COMMITTED = "commit 1\n\nnonlinear  100 x\nratio closed 0.600\nratio draw 2.000\n"


def compared(folder, text):
    """What the script prints, and its exit code, for new output of a benchmark."""

    def git(*arguments):
        subprocess.run(["git", *arguments], cwd=folder, check=True, capture_output=True)

    file = folder / "bench.txt"
    file.write_text(COMMITTED)
    git("init")
    git("add", "bench.txt")
    git("-c", "user.name=a", "-c", "user.email=a@b", "commit", "-m", "a")
    file.write_text(text)
    command = [sys.executable, SCRIPT, "bench.txt"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout, done.returncode


@pytest.mark.parametrize(
    "text",
    [
        "ratio closed 0.541\nratio draw 1.801\n",
        "ratio closed 0.900\nratio draw 3.000\nratio other 1.000\n",
    ],
    ids=["within a tenth", "better"],
)
def test_ratios_that_are_kept_pass(tmp_path, text):
    assert compared(tmp_path, text) == ("", 0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ratio closed 0.600\nratio draw 1.790\n", "draw 1.79, committed 2.0"),
        ("ratio draw 2.000\n", "closed is missing, committed 0.6"),
        ("ratio closed nan\nratio draw 2.000\n", "closed nan, committed 0.6"),
    ],
    ids=["worse", "missing", "no number"],
)
def test_a_worse_ratio_fails(tmp_path, text, said):
    assert compared(tmp_path, text) == (f"bench.txt: {said}\n", 1)
