"""What is kept is what was made: damaged, foreign and linked entries are made anew."""

import os
import pickle
import subprocess
import sys
from collections import OrderedDict
from hashlib import sha256

import pytest

from canroll import build_cache

NAME = sha256(b"same").hexdigest()


class Trap:
    """A pickle of it writes a file where it is loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


@pytest.fixture
def keep(monkeypatch, tmp_path):
    """Return a function that keeps a value in a cache of its own, as a new process would."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("CANROLL_NO_CACHE", raising=False)
    made = []

    def kept(value, of=b"same"):
        monkeypatch.setattr(build_cache, "_recent", OrderedDict())
        return build_cache.kept("things", of, lambda: made.append(value) or value)

    kept.made = made
    return kept


def entry():
    (path,) = build_cache.folder("things").iterdir()
    return path


def test_a_result_is_made_once(keep):
    assert [keep({"a": 1.5}), keep("other"), keep("new", b"else")] == [
        {"a": 1.5},
        {"a": 1.5},
        "new",
    ]
    assert keep.made == [{"a": 1.5}, "new"]


def test_what_is_returned_is_a_copy(keep):
    keep([1])
    again = keep(None)
    again.append(2)
    assert build_cache.kept("things", b"same", list) == [1]


def test_an_error_is_not_kept(keep):
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            build_cache.kept("things", b"same", lambda: 1 / 0)
    assert keep("made") == "made"


@pytest.mark.parametrize("cut", [0, 1, 31, 32, 33, -1])
def test_a_cut_entry_is_made_anew(keep, cut):
    keep("first" * 100)
    entry().write_bytes(entry().read_bytes()[:cut])
    assert [keep("anew"), keep("later")] == ["anew", "anew"]


def test_each_changed_byte_is_noticed(keep):
    keep("first")
    content = entry().read_bytes()
    for place in range(len(content)):
        entry().write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        assert keep(place) == place


def test_a_foreign_pickle_is_not_loaded(keep, tmp_path):
    keep("first")
    entry().write_bytes(pickle.dumps(Trap(tmp_path / "sprung")))
    assert keep("anew") == "anew"
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("mode", [0o620, 0o602])
def test_an_entry_that_others_may_write_is_not_read(keep, mode):
    keep("first")
    entry().chmod(mode)
    assert keep("anew") == "anew"


def test_an_entry_of_another_user_is_not_read(keep, monkeypatch):
    keep("first")
    user = os.geteuid()
    if user == 0:
        os.chown(entry(), 12345, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: user + 1)
    assert keep("anew") == "anew"


def test_a_link_or_pipe_in_place_of_an_entry_is_not_read(keep, tmp_path):
    keep("first")
    other = tmp_path / "other"
    entry().rename(other)
    place = other.parent / "canroll" / "things" / f"{NAME}.pickle"
    place.symlink_to(other)
    assert keep("anew") == "anew"
    assert not place.is_symlink()
    place.unlink()
    os.mkfifo(place)
    assert keep("once more") == "once more"


@pytest.mark.parametrize("open_to_all", ["canroll", "canroll/things"])
@pytest.mark.parametrize("mode", [0o770, 0o707])
def test_a_folder_that_others_may_write_is_not_used(keep, tmp_path, open_to_all, mode):
    keep("first")
    (tmp_path / open_to_all).chmod(mode)
    assert keep("anew") == "anew"


def test_folders_are_of_the_user_alone(keep, tmp_path):
    before = os.umask(0o002)
    keep("first")
    os.umask(before)
    for folder in (tmp_path / "canroll", tmp_path / "canroll" / "things"):
        assert folder.stat().st_mode & 0o777 == 0o700
    assert entry().stat().st_mode & 0o777 == 0o600


def test_judges_have_it_made_anew(keep, monkeypatch):
    keep("kept")
    monkeypatch.setenv("CANROLL_NO_CACHE", "1")
    assert keep("anew") == "anew"
    monkeypatch.delenv("CANROLL_NO_CACHE")
    assert keep("never") == "kept"


def test_a_killed_writer_leaves_nothing_that_is_read(keep, tmp_path):
    program = (
        "import os; from canroll import build_cache; "
        "os.replace = lambda *_: os._exit(9); build_cache.kept('things', b'same', lambda: 1)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 9
    assert keep("anew") == "anew"


def test_a_cache_that_cannot_be_written_changes_nothing(keep, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    assert keep("made", b"elsewhere") == "made"


def test_what_cannot_be_pickled_is_made_each_time():
    made = []
    for _ in range(2):
        assert build_cache.recalled(b"a lambda", lambda: made.append(1) or (lambda: 5))() == 5
    assert made == [1, 1]


def test_memory_is_bounded(keep):
    for number in range(2 * build_cache.RECENT):
        build_cache.recalled(bytes([number]), lambda: "text")
    assert len(build_cache._recent) == build_cache.RECENT


def test_keys_differ_by_each_bit_of_a_number():
    values = [0.0, -0.0, 1.0, 1, True, "1", 1.0 + 2**-52, (1.0,), [1.0], None]
    assert len({build_cache.key(value) for value in values}) == len(values)


def test_keys_are_equal_in_every_process():
    program = (
        "from canroll import build_cache, vehicles; "
        "print(build_cache.key(vehicles.load('van_real'), {'b', 'a'} and ('a', 'b')).hex())"
    )
    seen = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in "123"
    }
    assert len(seen) == 1


@pytest.fixture
def build(keep):
    """Return a function that keeps a file of code, made of a text, and returns its path."""

    def make(text):
        def write(folder):
            (folder / "x.o").write_text(text)
            (folder / "x.o").chmod(0o775)
            return folder / "x.o"

        return write

    return lambda text: build_cache.built("code", "x.so", make(text))


def test_code_is_made_once_and_is_of_the_user_alone(build):
    assert build("first") == build("anew")
    assert build("anew").read_text() == "first"
    names = {path.name: path.stat().st_mode & 0o777 for path in build("").parent.iterdir()}
    assert names == {"x.so": 0o700, "x.so.sha256": 0o600}


def test_code_that_is_cut_changed_or_of_others_is_made_anew(build, tmp_path):
    """A shared object that is cut ends each process that loads it, without a word."""
    path = build("first")
    path.write_text("fir")
    assert build("cut").read_text() == "cut"
    path.write_text("cuT")
    assert build("changed").read_text() == "changed"
    path.chmod(0o720)
    assert build("open").read_text() == "open"
    path.with_name("x.so.sha256").unlink()
    assert build("unknown").read_text() == "unknown"
    path.rename(tmp_path / "x")
    path.symlink_to(tmp_path / "x")
    assert build("linked").read_text() == "linked" and not path.is_symlink()
    os.chown(path, 12345, -1) if os.geteuid() == 0 else path.unlink()
    assert build("own").read_text() == "own"


def test_what_is_kept_is_on_the_disk_before_it_has_its_name(build, monkeypatch):
    seen = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda file: seen.append("sync") or fsync(file))
    monkeypatch.setattr(os, "replace", lambda *paths: seen.append("name") or replace(*paths))
    build("code")
    assert seen == ["sync", "name", "sync", "name"]
