"""Recorded traffic as background: logs that python-can reads, fed into a network."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import can
import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, UnknownNameError
from plant_sim.can_bus.kernel.layout import FREE_FRAME, MAX_PAYLOAD, NOW, Network
from plant_sim.can_bus.kernel.queues import enqueue
from plant_sim.can_bus.wire.frame import (
    BIT_RATE_SWITCH,
    EXTENDED,
    FD,
    RECEPTION_BITS_BEFORE_END,
    REMOTE,
    duration_ns,
    frame_bits,
)
from plant_sim.kernels.jit import njit

SUFFIXES: Final = (".asc", ".blf", ".log", ".mf4", ".csv", ".trc", ".db", ".pcap", ".pcapng")


class Frames(NamedTuple):
    """Recorded frames in the order of their queueing, times from 0 in nanoseconds."""

    t_ns: NDArray[np.int64]
    ident: NDArray[np.int64]
    flags: NDArray[np.int64]
    length: NDArray[np.int64]
    payload: NDArray[np.uint8]

    def piece(self, from_ns: int, to_ns: int) -> "Frames":
        """Return the frames queued from ``from_ns`` until before ``to_ns``, that start at 0."""
        part = slice(*np.searchsorted(self.t_ns, (from_ns, to_ns)))
        return Frames(
            self.t_ns[part] - from_ns,
            self.ident[part],
            self.flags[part],
            self.length[part],
            self.payload[part],
        )


@dataclass(frozen=True, slots=True)
class Recording:
    """Frames of one channel of a log, and the time from the first frame to the last."""

    frames: Frames
    channel: str
    duration_s: float


def load_recording(
    path: Path,
    *,
    bitrate: int,
    data_bitrate: int = 0,
    leave_out: Collection[tuple[int, bool]] = (),
    channel: str | None = None,
) -> Recording:
    """Read a log; its first frame is queued at time 0.

    A log has times of reception. Every frame is queued its own transmission time earlier, so that
    on a bus of the same ``bitrate`` with nothing else on it, it is received when it was recorded.

    Args:
        path: a log of a format python-can knows by its suffix.
        bitrate: of the recorded bus, bit/s.
        data_bitrate: of FD frames with bit-rate switch, 0: as ``bitrate``.
        leave_out: identifiers that are not replayed, such as those simulated anyway, each with
            whether it is extended.
        channel: of the log, as python-can names it; None: its only one.

    Raises:
        CanrollError: the file cannot be read, has no frame to replay, or has several channels and
            none is chosen.
        UnknownNameError: it has no such channel.
    """
    if not path.is_file():
        raise CanrollError(f"{path}: no such file")
    if path.suffix.lower() not in SUFFIXES:
        raise CanrollError(f"{path}: a bus log ends in {', '.join(SUFFIXES)}")
    try:
        with can.LogReader(path) as reader:
            messages = [m for m in reader if not m.is_error_frame]
    except CanrollError as error:
        raise CanrollError(f"{path}: {error}") from error
    except Exception as error:  # python-can's readers let through whatever their parsers raise
        raise CanrollError(f"{path}: not a readable bus log: {error}") from error
    channel, messages = _of_channel(path, messages, channel)
    times = [m.timestamp for m in messages]
    duration = max(times, default=0.0) - min(times, default=0.0)
    kept = np.array([(m.arbitration_id, m.is_extended_id) not in leave_out for m in messages], bool)
    if not kept.any():
        raise CanrollError(f"{path}: contains no frame to replay")
    payload = np.zeros((len(messages), MAX_PAYLOAD), np.uint8)
    ident = np.array([m.arbitration_id for m in messages], np.int64)
    length = np.array([min(m.dlc, MAX_PAYLOAD if m.is_fd else 8) for m in messages], np.int64)
    flags = np.array([flags_of(m) for m in messages], np.int64)
    start = messages[0].timestamp
    # microseconds are what logs hold; finer digits are the float's own
    received = np.array([round((m.timestamp - start) * 1e6) * 1000 for m in messages], np.int64)
    for i, message in enumerate(messages):
        data = bytes(message.data or b"")
        count = min(len(data), int(length[i]))
        payload[i, :count] = np.frombuffer(data, np.uint8)[:count]
        nominal, fast = frame_bits(int(ident[i]), int(flags[i]), int(length[i]), payload[i])
        taken = int(duration_ns(nominal - RECEPTION_BITS_BEFORE_END, bitrate))
        received[i] -= taken + int(duration_ns(fast, data_bitrate or bitrate))
    order = np.argsort(received, kind="stable")
    order = order[kept[order]]
    queued = received[order] - received.min()
    frames = Frames(queued, ident[order], flags[order], length[order], payload[order])
    return Recording(frames, channel, round(duration, 6))


def _of_channel(
    path: Path, messages: list[can.Message], channel: str | None
) -> tuple[str, list[can.Message]]:
    known = sorted({str(m.channel) for m in messages})
    if channel is None and len(known) > 1:
        raise CanrollError(
            f"{path}: frames of channels {', '.join(known)}: choose one with --channel"
        )
    chosen = channel if channel is not None else "".join(known)
    if messages and chosen not in known:
        raise UnknownNameError(f"channel of {path}", chosen, known)
    return chosen, [m for m in messages if str(m.channel) == chosen]


def flags_of(message: can.Message) -> int:
    """Return the flags of a python-can message, those of :mod:`plant_sim.can_bus.wire.frame`."""
    flags = (EXTENDED if message.is_extended_id else 0) | (REMOTE if message.is_remote_frame else 0)
    if message.is_fd:
        flags |= FD | (BIT_RATE_SWITCH if message.bitrate_switch else 0)
    return flags


@njit
def feed(network: Network, frames: Frames, node: int, cursor: int, until_ns: int) -> int:
    """Queue recorded frames up to ``until_ns`` from ``node``; call it before ``advance``.

    Returns:
        The cursor for the next call; the length of the recording when it is at its end. Stops
        early where the network's store is full, and goes on with the next call.
    """
    clock = network.state[0].clock
    while cursor < len(frames.t_ns) and frames.t_ns[cursor] <= until_ns:
        if clock[FREE_FRAME] < 0:
            break
        enqueue(
            network,
            node,
            max(frames.t_ns[cursor], clock[NOW]),
            frames.ident[cursor],
            frames.length[cursor],
            frames.payload[cursor],
            frames.flags[cursor],
        )
        cursor += 1
    return cursor
