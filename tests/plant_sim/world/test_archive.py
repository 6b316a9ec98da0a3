"""Archives in blocks: the bytes of NumPy's, read without trusting what a header says."""

import io
import struct
import zipfile

import numpy as np
import pytest
from numpy.lib import format as npy

from canroll.errors import UNREADABLE
from canroll.plant_sim.world import archive, spool
from canroll.plant_sim.world.spool import Rows, as_columns

ROW = np.dtype([("t", "f8"), ("payload", "u1", (3,))])


def entries():
    source = np.random.default_rng(1)
    table = np.zeros(5000, ROW)
    table["t"] = source.normal(size=5000)
    table["payload"] = source.integers(0, 9, (5000, 3))
    return {
        "signals": {"a": source.normal(size=7000).round(2), "b": np.ones(7000)},
        "run/rows": table,
        "names": np.array(["a", "b"]),
        "done": np.asarray(True),
    }


@pytest.mark.parametrize("compressed", [True, False])
@pytest.mark.parametrize("in_memory", [1 << 20, 0])
def test_the_bytes_are_those_of_numpy(compressed, in_memory, tmp_path, monkeypatch):
    monkeypatch.setattr(spool, "IN_MEMORY", in_memory)
    found = entries()
    signals, table = found["signals"], found["run/rows"]
    ours = {
        **found,
        "signals": as_columns(signals),
        "run/rows": Rows(ROW, [table[:100], table[100:4000], table[4000:]]),
    }
    archive.write(tmp_path / "ours.npz", ours, compressed=compressed)
    save = np.savez_compressed if compressed else np.savez
    save(tmp_path / "theirs.npz", **{**found, "signals": np.array(list(signals.values()))})
    assert (tmp_path / "ours.npz").read_bytes() == (tmp_path / "theirs.npz").read_bytes()

    with archive.Archive(tmp_path / "ours.npz") as stored:
        again = stored.signals("signals", ["a", "b"])
        assert all(np.array_equal(again[name], values) for name, values in signals.items())
        assert stored.rows("run/rows").tobytes() == table.tobytes()
        assert stored.array("names").tolist() == ["a", "b"]
        assert bool(stored.array("done"))
        assert "other" not in stored


@pytest.mark.parametrize("read", ["array", "rows"])
def test_a_header_that_claims_more_than_is_there_is_refused(read, tmp_path):
    """10¹² numbers in a few bytes: no memory is taken for them."""
    path = tmp_path / "few.npz"
    member = io.BytesIO()
    np.save(member, np.zeros(100))
    claim = member.getvalue().replace(b"(100,), }            ", b"(1000000000000,), }  ")
    assert b"1000000000000" in claim
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("values.npy", claim)
    with (
        pytest.raises(UNREADABLE, match="800 bytes for 1000000000000 entries"),
        archive.Archive(path) as stored,
    ):
        getattr(stored, read)("values")


def test_no_objects_are_unpickled(tmp_path):
    path = tmp_path / "objects.npz"
    np.savez(path, values=np.array([print], dtype=object))
    with archive.Archive(path) as stored, pytest.raises(UNREADABLE):
        stored.array("values")


def test_a_truncated_archive_is_refused(tmp_path):
    path = tmp_path / "cut.npz"
    np.savez(path, values=np.zeros(100))
    path.write_bytes(path.read_bytes()[:400] + struct.pack("<I", 7))
    with pytest.raises(UNREADABLE):
        archive.Archive(path)


@pytest.mark.parametrize("header", ["{'descr': '<f8\0", "{'descr': ('<f8", "  {\n {\n}", "(" * 300])
def test_a_header_that_cannot_be_parsed_is_refused(header, tmp_path):
    path = tmp_path / "damaged.npz"
    content = npy.magic(1, 0) + len(header).to_bytes(2, "little") + header.encode()
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("values.npy", content)
    with archive.Archive(path) as stored, pytest.raises(UNREADABLE):
        stored.array("values")
