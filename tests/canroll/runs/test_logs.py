"""Bus logs: every format has the same frames at the same times, from the start of the run."""

import sys
from pathlib import Path

import can
import numpy as np
import pytest

from canroll.errors import CanrollError, MissingExtraError
from canroll.plant_sim.can_bus.kernel.layout import DELIVERED, ERROR, LOST_OVERFLOW, log_dtype
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, ERROR_STATE, EXTENDED, FD, REMOTE
from canroll.runs.logs import SUFFIXES, check_suffix, write_log

ROWS = (
    # time in ns, identifier, flags, length, segment, outcome
    (12_345_678, 0x123, 0, 8, 0, DELIVERED),
    (20_000_000, 0x1ABCDEF0, EXTENDED, 3, 0, DELIVERED),
    (30_000_001, 0x10, FD, 12, 1, DELIVERED),
    (40_000_000, 0x18FF00F1, EXTENDED | FD | BIT_RATE_SWITCH, 64, 0, DELIVERED),
    (50_000_000, 0x11, FD | BIT_RATE_SWITCH | ERROR_STATE, 8, 0, DELIVERED),
    (55_000_000, 0x12, REMOTE, 5, 0, DELIVERED),
    (60_000_000, 0x13, 0, 8, 0, ERROR),
    (70_000_000, 0x14, 0, 8, 0, LOST_OVERFLOW),
    (1_234_567_890, 0x15, 0, 0, 0, DELIVERED),
)


def frames():
    """The rows, the first two as a bus logs them of which a gateway passes one on."""
    found = np.zeros(len(ROWS), log_dtype())
    for entry, row in zip(found, ROWS, strict=True):
        for key, value in zip(
            ("t_received", "ident", "flags", "length", "segment", "outcome"), row, strict=True
        ):
            entry[key] = value
        entry["payload"][: row[3]] = np.arange(1, row[3] + 1)
    return found[[1, 0, *range(2, len(ROWS))]]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_written_is_read_back(tmp_path, suffix):
    if suffix == ".mf4":
        pytest.importorskip("asammdf", reason="needs asammdf")
    written = frames()
    if suffix == ".pcap":
        written["segment"] = 1
    path = write_log(tmp_path / f"bus{suffix}", written)
    with can.LogReader(path) as reader:
        found = list(reader)
    seen = [row for row in ROWS if row[5] != LOST_OVERFLOW]
    assert [m.timestamp for m in found] == pytest.approx([r[0] * 1e-9 for r in seen], abs=1e-6)
    for message, (_, ident, flags, length, segment, outcome) in zip(found, seen, strict=True):
        assert message.is_error_frame == (outcome == ERROR)
        if outcome == ERROR:
            continue
        if suffix != ".pcap":
            assert str(message.channel) in {str(segment), f"can{segment}"}
        assert message.arbitration_id == ident
        assert message.is_extended_id == bool(flags & EXTENDED)
        assert message.is_remote_frame == bool(flags & REMOTE)
        assert message.is_fd == bool(flags & FD)
        assert message.bitrate_switch == bool(flags & BIT_RATE_SWITCH)
        assert message.error_state_indicator == bool(flags & ERROR_STATE)
        assert bytes(message.data) == bytes(range(1, 0 if flags & REMOTE else length + 1))


def test_a_pcap_has_one_channel(tmp_path):
    with pytest.raises(CanrollError, match=r"frames of 0 and 1: write a \.pcapng"):
        write_log(tmp_path / "bus.pcap", frames())


def test_a_missing_asammdf_is_found_before_the_run(monkeypatch):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(MissingExtraError, match=r"--log FILE.mf4 needs asammdf: pip install"):
        check_suffix(Path("bus.mf4"))
