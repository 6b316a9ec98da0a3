"""Tables of a run: what they give is the same in memory and in a file."""

import os
import pickle
import resource

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.world import spool
from canroll.plant_sim.world.spool import Columns, Rows, as_columns, blocks, pieces, with_signal

ROW = np.dtype([("t", "f8"), ("kind", "u1")])


@pytest.fixture(params=["memory", "file", "both"])
def place(request, monkeypatch):
    """Where a table of a few hundred bytes lies."""
    size = {"memory": 1 << 20, "file": 0, "both": 100}[request.param]
    monkeypatch.setattr(spool, "IN_MEMORY", size)


def rows(count, first=0):
    found = np.zeros(count, ROW)
    found["t"] = np.arange(first, first + count)
    found["kind"] = found["t"] % 3
    return found


@pytest.mark.usefixtures("place")
def test_rows_are_those_appended():
    parts = [rows(5), rows(0), rows(7, 5), rows(40, 12)]
    whole = np.concatenate(parts)
    table = Rows(ROW, parts)
    assert len(table) == 52
    assert table.tobytes() == whole.tobytes()
    assert np.array_equal(table["t"], whole["t"])
    assert np.array_equal(table[table["kind"] == 1], whole[whole["kind"] == 1])
    assert np.concatenate(list(blocks(table))).tobytes() == whole.tobytes()
    assert pickle.loads(pickle.dumps(table)).tobytes() == whole.tobytes()


@pytest.mark.usefixtures("place")
def test_rows_are_copies():
    buffer = rows(20)
    table = Rows(ROW)
    for _ in range(3):
        table.append(buffer)
        buffer["t"] += 100
    assert table["t"][[0, 20, 40]].tolist() == [0, 100, 200]


@pytest.mark.usefixtures("place")
def test_signals_are_those_appended():
    values = np.arange(60.0).reshape(3, 20)
    table = Columns(["a", "b", "c"])
    for first, end in ((0, 4), (4, 4), (4, 15), (15, 20)):
        table.append(values[:, first:end])
    assert list(table) == ["a", "b", "c"]
    for name, row in zip("abc", values, strict=True):
        assert np.array_equal(table[name], row)
    joined = [np.concatenate(part) for part in zip(*pieces(table, "c", "a"), strict=True)]
    assert np.array_equal(joined, values[[2, 0]])
    again = pickle.loads(pickle.dumps(table))
    assert all(np.array_equal(again[name], table[name]) for name in table)
    with pytest.raises(KeyError):
        table["d"]


@pytest.mark.usefixtures("place")
def test_a_signal_is_replaced_in_place():
    signals = {"a": np.arange(9.0), "b": np.ones(9)}
    for table in (signals, as_columns(signals)):
        found = with_signal(table, "a", [np.full(4, 7.0), np.full(5, 7.0)])
        assert list(found) == ["a", "b"]
        assert np.all(found["a"] == 7.0)
        assert np.array_equal(table["a"], np.arange(9.0))
        assert all(np.all(part == 7.0) for part, _ in pieces(found, "a", "b"))


def test_no_table_keeps_more_than_its_share_in_memory(monkeypatch):
    monkeypatch.setattr(spool, "IN_MEMORY", 1000)
    table = spool.Spool(np.dtype("f8"))
    for _ in range(50):
        table.append(np.ones(30))
        assert table.bytes_in_memory <= 1000
    assert table.bytes_in_memory == 960


def test_a_full_disk_is_named(monkeypatch):
    """A file that may not grow ends the run with its folder, not with a traceback."""
    monkeypatch.setattr(spool, "IN_MEMORY", 0)
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
        try:
            Rows(ROW, [rows(500)])
        except CanrollError as error:
            os._exit(0 if "set TMPDIR" in str(error) else 1)
        os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_a_signal_is_replaced_without_reading_the_others(monkeypatch):
    monkeypatch.setattr(spool, "IN_MEMORY", 0)
    table = Columns(["a", "b"])
    table.append(np.arange(6.0).reshape(2, 3))
    monkeypatch.setattr(table._spool, "read", lambda *_: pytest.fail("read"))
    assert np.array_equal(with_signal(table, "a", [np.ones(3)])["a"], np.ones(3))


@pytest.mark.usefixtures("place")
def test_pieces_do_not_depend_on_the_blocks_that_were_recorded(monkeypatch):
    monkeypatch.setattr(spool, "PIECE", 4)
    values = np.arange(22.0).reshape(2, 11)
    whole, parts = Columns(["a", "b"]), Columns(["a", "b"])
    whole.append(values)
    for first, last in ((0, 3), (3, 4), (4, 9), (9, 11)):
        parts.append(values[:, first:last].copy())
    replaced = with_signal(parts, "b", iter([values[1, :10], values[1, 10:]]))
    for table in (dict(zip("ab", values, strict=True)), whole, parts, replaced):
        assert [a.tolist() for a, _ in pieces(table, "a", "b")] == [
            [0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10]
        ]  # fmt: skip
        assert np.array_equal(np.concatenate([b for _, b in pieces(table, "a", "b")]), values[1])
        assert spool.row_count(table) == 11
    assert list(pieces(Columns(["a"]), "a")) == []
