"""A folder's files are replaced whole or not at all, whenever the process ends."""

import os
import random
import signal
import subprocess
import sys

import pytest

from canroll.errors import CanrollError
from canroll.report import staging

KEY = "result"
NAMES = ("a", "b", "c", KEY)
WRITER = """
import sys
from itertools import count
from pathlib import Path
from canroll.report import staging
for n in count():
    with staging.replaced(Path(sys.argv[1]), "result") as part:
        for name in ("a", "b", "c", "result"):
            (part / name).write_text(str(n) * 20_000)
    print(n, flush=True)
"""


def write(folder, text):
    with staging.replaced(folder, KEY) as part:
        for name in NAMES:
            (part / name).write_text(text)


def read(folder):
    """The set of what the files say; nothing where the folder is none."""
    if not (folder / KEY).exists():
        return set()
    return {(folder / name).read_text() for name in NAMES}


def test_files_come_together_and_nothing_else_is_touched(tmp_path):
    (tmp_path / "mine.txt").write_text("kept")
    write(tmp_path, "old")
    write(tmp_path, "new")
    assert read(tmp_path) == {"new"}
    assert (tmp_path / "mine.txt").read_text() == "kept"
    assert not [path for path in tmp_path.iterdir() if path.is_dir()]


def test_an_error_leaves_what_was_there(tmp_path):
    write(tmp_path, "old")
    with pytest.raises(ZeroDivisionError), staging.replaced(tmp_path, KEY) as part:
        (part / "a").write_text("new")
        raise ZeroDivisionError
    assert read(tmp_path) == {"old"}


@pytest.mark.parametrize("step", range(len(NAMES)))
def test_an_end_between_two_moves_leaves_no_mixture(tmp_path, monkeypatch, step):
    write(tmp_path, "old")
    moves = []
    replace = os.replace

    def killed(source, target):
        if len(moves) == step:
            raise SystemExit
        moves.append(target)
        replace(source, target)

    monkeypatch.setattr(os, "replace", killed)
    with pytest.raises(SystemExit):
        write(tmp_path, "new")
    assert read(tmp_path) == set()
    monkeypatch.undo()
    write(tmp_path, "again")
    assert read(tmp_path) == {"again"}


def test_a_killed_writer_leaves_no_mixture(tmp_path):
    rng = random.Random(5)
    for _ in range(10):
        child = subprocess.Popen(
            [sys.executable, "-c", WRITER, tmp_path], stdout=subprocess.PIPE, text=True
        )
        assert child.stdout is not None
        for _ in range(rng.randrange(1, 30)):
            child.stdout.readline()
        child.send_signal(signal.SIGKILL)
        child.wait()
        child.stdout.close()
        assert len(read(tmp_path)) <= 1
    write(tmp_path, "last")
    assert read(tmp_path) == {"last"}
    assert not [path for path in tmp_path.iterdir() if path.is_dir()]


def test_a_second_writer_is_refused(tmp_path):
    with staging.replaced(tmp_path, KEY) as part:
        with pytest.raises(CanrollError, match="another canroll writes to"):
            write(tmp_path, "second")
        for name in NAMES:
            (part / name).write_text("first")
    assert read(tmp_path) == {"first"}


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(CanrollError, match=r"cannot write to .*nowhere"):
        write(tmp_path / "nowhere", "new")
