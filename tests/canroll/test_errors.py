"""What cannot be read or written is said in one line with its reason and remedy."""

import errno
import os

import pytest

from canroll.errors import CanrollError, UnknownNameError, reading, writing


def test_what_cannot_be_written_names_place_reason_and_remedy():
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(CanrollError) as raised, writing("to out", "choose another --out"):
        raise full
    assert str(raised.value) == "cannot write to out: No space left on device: choose another --out"
    assert raised.value.__cause__ is full


def test_a_file_that_is_damaged_or_missing_cannot_be_read(tmp_path):
    path = tmp_path / "missing"
    missing = f"cannot read {path}: No such file or directory$"
    with pytest.raises(CanrollError, match=missing), reading(path):
        path.read_text()
    with pytest.raises(CanrollError, match=f"cannot read {path}: not 3 columns$"), reading(path):
        raise ValueError("not 3 columns\nat all")


def test_an_error_that_says_what_to_do_stays_as_it_is():
    with pytest.raises(UnknownNameError, match="unknown law 'x'"), reading("file"):
        raise UnknownNameError("law", "x", ("lqr",))
