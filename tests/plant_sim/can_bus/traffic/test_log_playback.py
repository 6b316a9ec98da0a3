"""Replay of recorded traffic, from every common log format."""

import logging

import can
import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus import (
    NetworkSpec,
    Node,
    Segment,
    Source,
    account,
    advance,
    build_network,
    drain,
    enqueue,
)
from canroll.plant_sim.can_bus.traffic.log_playback import feed, load_recording

MS = 1_000_000


def recorded(path, *, seconds=1.0):
    """Record a simulated bus into a log file and return what was on it."""
    sources = tuple(
        Source("a", ident, length, period * MS, offset_ns=ident * 1000)
        for ident, length, period in ((0x100, 8, 10), (0x200, 3, 7), (0x300, 0, 13))
    )
    network = build_network(NetworkSpec((Segment(500_000),), (Node("a"), Node("b")), sources))
    enqueue(network, 1, 50 * MS, 0x18FF0001, 5, np.arange(8, dtype=np.uint8), 1)
    advance(network, int(seconds * 1e9))
    entries, _, _ = drain(network, 0)
    logger = can.Logger(path)
    for e in entries:
        logger(
            can.Message(
                timestamp=1e9 + e["t_received"] * 1e-9,
                arbitration_id=int(e["ident"]),
                is_extended_id=bool(e["flags"] & 1),
                data=bytes(e["payload"][: e["length"]]),
                channel=0,
            )
        )
    logger.stop()
    return entries


def replay(frames, **options):
    network = build_network(
        NetworkSpec((Segment(500_000),), (Node("player", policy="priority"), Node("x")), **options)
    )
    cursor = 0
    for until in range(10 * MS, 1_100 * MS, 10 * MS):
        cursor = feed(network, frames, 0, cursor, until)
        advance(network, until)
    assert cursor == len(frames.t_ns)
    assert account(network, 0).balanced
    return drain(network, 0)[0]


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log"])
def test_a_replayed_log_is_received_when_it_was_recorded(tmp_path, suffix):
    path = tmp_path / f"bus{suffix}"
    before = recorded(path)
    after = replay(load_recording(path, bitrate=500_000).frames)
    assert len(after) == len(before)
    assert list(after["ident"]) == list(before["ident"])
    assert (after["payload"] == before["payload"]).all()
    assert (after["flags"] == before["flags"]).all()
    shift = (after["t_received"] - before["t_received"]).astype(float)
    # frames that waited in the recording are queued later now; the log's digits do the rest
    assert np.abs(shift - np.median(shift)).max() < 0.3 * MS


def test_replayed_frames_compete_with_others(tmp_path):
    path = tmp_path / "bus.log"
    before = recorded(path)
    recording = load_recording(path, bitrate=500_000, leave_out={(0x200, False)})
    urgent = Source("x", 0x010, 8, 1 * MS)
    log = replay(recording.frames, sources=(urgent,))
    mine = log[log["sender"] == 0]
    assert 0x200 not in mine["ident"]
    assert len(mine) == (before["ident"] != 0x200).sum()
    assert (mine["t_start"] > mine["t_queued"]).any()


def test_time_starts_with_the_log_whatever_is_left_out(tmp_path):
    path = tmp_path / "bus.log"
    recorded(path)
    whole = load_recording(path, bitrate=500_000).frames
    rest = load_recording(path, bitrate=500_000, leave_out={(0x100, False)}).frames
    assert whole.ident[0] == 0x100
    assert (rest.t_ns == whole.t_ns[whole.ident != 0x100]).all()


@pytest.mark.parametrize("level", [logging.NOTSET, logging.CRITICAL])
def test_a_log_of_which_frames_would_be_passed_over_is_refused(tmp_path, capfd, caplog, level):
    # who opens a bus lets python-can log no more than what is critical
    caplog.set_level(level, "can")
    path = tmp_path / "drive.trc"
    recorded(path)
    load_recording(path, bitrate=500_000)
    path.write_text(path.read_text() + "999        13.000 DT  1\n")
    said = r"drive\.trc: not a readable bus log: line \d+: not a line of a \.trc: '999"
    with pytest.raises(CanrollError, match=said):
        load_recording(path, bitrate=500_000)
    assert capfd.readouterr().err == ""
