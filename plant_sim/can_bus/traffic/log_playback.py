"""Recorded traffic as background: bus logs fed into a network."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.kernel.layout import FREE_FRAME, NOW, Network
from canroll.plant_sim.can_bus.kernel.queues import enqueue
from canroll.plant_sim.can_bus.traffic.log_reader import (
    Logged,
    Progress,
    read_log,
    select_channel,
    transmission_times,
)
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, RECEPTION_BITS_BEFORE_END
from canroll.plant_sim.kernels.jit import njit


class RecordedFrames(NamedTuple):
    """Recorded frames in the order of queueing, times in nanoseconds from 0."""

    t_ns: NDArray[np.int64]
    ident: NDArray[np.int64]
    flags: NDArray[np.int64]
    length: NDArray[np.int64]
    payload: NDArray[np.uint8]

    def piece(self, from_ns: int, to_ns: int) -> "RecordedFrames":
        """Return the frames queued in [``from_ns``, ``to_ns``), with times from 0."""
        part = slice(*np.searchsorted(self.t_ns, (from_ns, to_ns)))
        return RecordedFrames(
            self.t_ns[part] - from_ns,
            self.ident[part],
            self.flags[part],
            self.length[part],
            self.payload[part],
        )


@dataclass(frozen=True, slots=True)
class Recording:
    """Frames of one channel of a log, and the duration from the first frame to the last.

    ``errors``: number of error frames in the log; ``remarks``: what was left out of it.
    """

    frames: RecordedFrames
    channel: str
    duration_s: float
    errors: int = 0
    remarks: tuple[str, ...] = ()


def load_recording(
    path: Path,
    *,
    bitrate: int,
    data_bitrate: int = 0,
    leave_out: Collection[tuple[int, bool]] = (),
    channel: str | None = None,
    section: int | None = None,
    progress: Progress | None = None,
) -> Recording:
    """Read a log; its first frame is queued at time 0.

    Args:
        path: a log of a format python-can knows by its suffix.
        bitrate: of the recorded bus, bit/s.
        data_bitrate: of FD frames with bit-rate switch, 0: as ``bitrate``.
        leave_out: identifiers that are not replayed, such as simulated ones, each with a flag for
            extended.
        channel: of the log, as named by python-can; None: the only one.
        section: of a log whose times step, see ``read_log``.
        progress: called with the activity and the fraction done.

    Raises:
        CanrollError: the file cannot be read, has no frame to replay, or has several channels and
            none is chosen.
        UnknownNameError: it has no such channel.
    """
    logged = select_channel(path, read_log(path, section=section, progress=progress), channel)
    pairs = zip(logged.ident, logged.flags & EXTENDED != 0, strict=True)
    kept = np.array([(int(i), bool(x)) not in leave_out for i, x in pairs], bool)
    if not kept.any():
        raise CanrollError(f"{path}: contains no frame to replay")
    return recording_of(logged, bitrate=bitrate, data_bitrate=data_bitrate, kept=kept)


def recording_of(
    logged: Logged, *, bitrate: int, data_bitrate: int = 0, kept: NDArray[np.bool_] | None = None
) -> Recording:
    """Return the frames of a channel, only those of the mask ``kept``, with times of queueing.

    A log has times of reception. Every frame is queued its transmission time earlier, so that on an
    otherwise idle bus of the same ``bitrate`` it is received when it was recorded.
    """
    started = start_times(logged, bitrate=bitrate, data_bitrate=data_bitrate)
    order = np.argsort(started, kind="stable")
    if kept is not None:
        order = order[kept[order]]
    frames = RecordedFrames(
        started[order] - started.min(),
        logged.ident[order],
        logged.flags[order],
        logged.length[order],
        logged.payload[order],
    )
    duration = int(logged.received_ns[-1] - logged.received_ns[0]) * 1e-9
    return Recording(
        frames, logged.channel, round(duration, 6), len(logged.errors_ns), logged.remarks
    )


def start_times(logged: Logged, *, bitrate: int, data_bitrate: int = 0) -> NDArray[np.int64]:
    """Return the start of each frame's transmission, ns, computed from its reception."""
    nominal = logged.nominal_bits - RECEPTION_BITS_BEFORE_END
    taken = transmission_times(nominal, logged.data_bits, bitrate, data_bitrate)
    started: NDArray[np.int64] = logged.received_ns - taken
    return started


@njit
def feed(network: Network, frames: RecordedFrames, node: int, cursor: int, until_ns: int) -> int:
    """Queue recorded frames up to ``until_ns`` from ``node``; call it before ``advance``.

    Returns:
        The cursor for the next call; at the end, the length of the recording. Stops early if the
        network's store is full, and continues with the next call.
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
