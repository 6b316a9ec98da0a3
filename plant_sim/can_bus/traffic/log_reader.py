"""Frames of a bus log by channel, from every format that python-can reads by suffix."""

import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple

import can
import numpy as np
from numpy.typing import NDArray

from canroll import documents
from canroll.errors import CanrollError, UnknownNameError, reason
from plant_sim.can_bus.kernel.layout import MAX_PAYLOAD
from plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD, REMOTE, frame_bits

SUFFIXES: Final = (".asc", ".blf", ".log", ".mf4", ".csv", ".trc", ".db", ".pcap", ".pcapng")

_FIELDS: Final = (
    *("timestamp", "arbitration_id", "is_extended_id", "is_remote_frame", "is_error_frame"),
    *("is_fd", "bitrate_switch", "error_state_indicator", "is_rx"),
)
_MF4_TO_NPZ: Final = f"""
import logging, sys, can, numpy
logging.disable()
with can.LogReader(sys.argv[1]) as reader:
    found = list(reader)
data = numpy.zeros((len(found), {MAX_PAYLOAD}), numpy.uint8)
for row, message in zip(data, found):
    row[: len(message.data)] = list(message.data)
columns = {{name: numpy.array([getattr(m, name) for m in found]) for name in {_FIELDS}}}
channel = [-1 if m.channel is None else m.channel for m in found]
dlc = numpy.array([m.dlc for m in found])
numpy.savez(sys.stdout.buffer, data=data, dlc=dlc, channel=numpy.array(channel), **columns)
"""
"""asammdf is ended by some damaged files."""

LATEST: Final = 4e9
"""Largest time stamp of a frame, s, since 1970 or the start: it fits 63 bits in ns."""


def is_log(path: Path) -> bool:
    """Return whether a path has the suffix of a bus log."""
    return path.suffix.lower() in SUFFIXES


class Logged(NamedTuple):
    """One channel of a log in the order of reception, one entry per frame.

    Times of reception in nanoseconds, 0 at the log's first frame of any channel; whole
    microseconds, which is what logs hold. ``nominal_bits`` and ``data_bits``: lengths on the wire,
    see ``frame_bits``. ``errors_ns``: times of the error frames, which are not among the others.
    """

    channel: str
    received_ns: NDArray[np.int64]
    ident: NDArray[np.int64]
    flags: NDArray[np.int64]
    length: NDArray[np.int64]
    payload: NDArray[np.uint8]
    nominal_bits: NDArray[np.int64]
    data_bits: NDArray[np.int64]
    errors_ns: NDArray[np.int64]


def read_log(path: Path) -> dict[str, Logged]:
    """Return the channels of a log by name, as python-can names them.

    Raises:
        CanrollError: the file cannot be read.
    """
    if not path.is_file():
        raise CanrollError(f"{path}: no such file")
    if not is_log(path):
        raise CanrollError(f"{path}: a bus log ends in {', '.join(SUFFIXES)}")
    try:
        return _channels(_messages(path))
    except CanrollError as error:
        raise CanrollError(f"{path}: {error}") from error
    except Exception as error:  # python-can's readers let through whatever their parsers raise
        raise CanrollError(f"{path}: not a readable bus log: {reason(error)}") from error


def _messages(path: Path) -> list[can.Message]:
    if path.suffix.lower() == ".mf4" and find_spec("asammdf"):
        return _read_mf4(path)
    with _nothing_dropped(), can.LogReader(path) as reader:
        return list(reader)


def _channels(messages: list[can.Message]) -> dict[str, Logged]:
    """Sort messages by channel; a field of one, as those of a .db, may be of any type."""
    if not all(abs(message.timestamp) < LATEST for message in messages):
        raise ValueError(f"a time is beyond {LATEST:g} s")
    channels: dict[str, list[can.Message]] = {}
    for message in messages:
        channels.setdefault(str(message.channel), []).append(message)
    start = messages[0].timestamp if messages else 0.0
    return {name: _logged(name, channels[name], start) for name in sorted(channels)}


@contextmanager
def _nothing_dropped() -> Iterator[None]:
    """Raise what python-can only warns of: it passes over a line of .trc that it cannot parse."""
    said: list[str] = []
    log, listener = logging.getLogger("can.io"), logging.Handler(logging.WARNING)
    listener.emit = lambda record: said.append(record.getMessage())  # type: ignore[method-assign]
    passed_on, log.propagate = log.propagate, False
    level = log.level
    log.setLevel(logging.WARNING)
    log.addHandler(listener)
    try:
        yield
    finally:
        log.removeHandler(listener)
        log.setLevel(level)
        log.propagate = passed_on
    if said:
        raise ValueError(said[0])


def _read_mf4(path: Path) -> list[can.Message]:
    with np.load(io.BytesIO(documents.read_apart(_MF4_TO_NPZ, path))) as stored:
        found = dict(stored)
    columns = [found[name].tolist() for name in (*_FIELDS, "channel", "dlc")]
    return [
        can.Message(
            **dict(zip(_FIELDS, row, strict=True)),
            channel=None if channel < 0 else channel,
            dlc=length,
            data=None if row[_FIELDS.index("is_remote_frame")] else data[:length].tobytes(),
        )
        for *row, channel, length, data in zip(*columns, found["data"], strict=True)
    ]


def select_channel(path: Path, channels: dict[str, Logged], name: str | None) -> Logged:
    """Return a channel by name; None: the only one that has frames.

    Raises:
        CanrollError: no frame, or frames of several channels and none is chosen.
        UnknownNameError: there is no such channel.
    """
    known = [channel for channel, logged in channels.items() if len(logged.ident)]
    if not known:
        raise CanrollError(f"{path}: contains no frame")
    if name is None and len(known) > 1:
        raise CanrollError(
            f"{path}: frames of channels {', '.join(known)}: choose one with --channel"
        )
    if name is not None and name not in known:
        raise UnknownNameError(f"channel of {path}", name, known)
    return channels[name or known[0]]


def _logged(channel: str, messages: list[can.Message], start: float) -> Logged:
    def stamps(chosen: list[can.Message]) -> NDArray[np.int64]:
        return np.array([round((m.timestamp - start) * 1e6) * 1000 for m in chosen], np.int64)

    errors = stamps([m for m in messages if m.is_error_frame])
    frames = [m for m in messages if not m.is_error_frame]
    received = stamps(frames)
    order = np.argsort(received, kind="stable")
    payload = np.zeros((len(frames), MAX_PAYLOAD), np.uint8)
    ident = np.array([m.arbitration_id for m in frames], np.int64)
    length = np.array([min(m.dlc, MAX_PAYLOAD if m.is_fd else 8) for m in frames], np.int64)
    flags = np.array([flags_of(m) for m in frames], np.int64)
    bits = np.zeros((len(frames), 2), np.int64)
    for i, message in enumerate(frames):
        data = bytes(message.data or b"")
        count = min(len(data), int(length[i]))
        payload[i, :count] = np.frombuffer(data, np.uint8)[:count]
        bits[i] = frame_bits(int(ident[i]), int(flags[i]), int(length[i]), payload[i])
    return Logged(
        channel,
        received[order],
        ident[order],
        flags[order],
        length[order],
        payload[order],
        bits[order, 0],
        bits[order, 1],
        np.sort(errors),
    )


def transmission_times(
    nominal: NDArray[np.int64], data: NDArray[np.int64], bitrate: int, data_bitrate: int
) -> NDArray[np.int64]:
    """Return the transmission times of frames, ns; ``data_bitrate`` 0: as nominal."""

    def rounded(bits: NDArray[np.int64], rate: int) -> NDArray[np.int64]:
        time: NDArray[np.int64] = (bits * 1_000_000_000 + rate // 2) // rate
        return time

    total: NDArray[np.int64] = rounded(nominal, bitrate) + rounded(data, data_bitrate or bitrate)
    return total


def flags_of(message: can.Message) -> int:
    """Return the flags of a python-can message, those of :mod:`plant_sim.can_bus.wire.frame`."""
    flags = EXTENDED if message.is_extended_id else 0
    if message.is_fd:
        # FD has no remote frames, though python-can reads an empty one of an .asc as such
        return flags | FD | (BIT_RATE_SWITCH if message.bitrate_switch else 0)
    return flags | (REMOTE if message.is_remote_frame else 0)
