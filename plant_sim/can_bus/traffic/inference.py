"""From a log to messages: those on a recorded bus, and their evidence."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.kernel.network import check_rates
from canroll.plant_sim.can_bus.traffic.arrivals import find_arrivals
from canroll.plant_sim.can_bus.traffic.log_playback import Recording, recording_of
from canroll.plant_sim.can_bus.traffic.log_reader import Logged, Progress, read_log, select_channel
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.traffic.queueing import QueueTimes, queue_times
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, REMOTE

RECORDED = "Recorded"
"""Node that represents all senders of a log, which does not name them."""
_TOO_CLOSE = 0.7
"""Share of its length within which no frame can follow, even with inexact time stamps."""


@dataclass(frozen=True, slots=True)
class InferredMessage:
    """One identifier of a log: as a message, its number of frames, and the lengths seen.

    ``assumed``: it is sent on events, so that its curve holds only for the recording. ``seen_ns``:
    the longest recorded response from the release to the end of the interframe space; 0 for an
    identifier that is not periodic.
    """

    message: BusMessage
    frames: int
    lengths: tuple[int, ...]
    assumed: bool
    seen_ns: int


@dataclass(frozen=True, slots=True)
class InferredBus:
    """One channel of a log: bit rates, its messages in the order of arbitration, its frames.

    ``data_bitrate`` is 0 without frames with bit-rate switch. ``too_close``: share of frames that
    came sooner than the rates (bit/s) allow. ``span_ns``: from the start of the first frame to the
    end of the last.
    """

    channel: str
    bitrate: int
    data_bitrate: int
    too_close: float
    messages: tuple[InferredMessage, ...]
    recording: Recording
    span_ns: int
    busy_ns: int

    @property
    def load(self) -> float:
        """Bus load of the recorded frames, 0 to 1."""
        return self.busy_ns / self.span_ns


def infer_buses(
    path: Path,
    *,
    channel: str | None = None,
    bitrate: int | None = None,
    data_bitrate: int | None = None,
    section: int | None = None,
    progress: Progress | None = None,
) -> list[InferredBus]:
    """Return the channels of a log that have frames, with their messages and evidence.

    Args:
        path: a log of a format that is read, by its suffix.
        channel: the only one, as python-can names it; None: all.
        bitrate: of the bus, bit/s.
        data_bitrate: of FD frames with bit-rate switch, bit/s.
        section: of a log whose times step, see ``read_log``.
        progress: called with the activity and the fraction done.

    Raises:
        CanrollError: the file cannot be read, has no frame, or a bit rate is not given.
        UnknownNameError: it has no such channel.
    """
    channels = read_log(path, section=section, progress=progress)
    chosen = [logged for logged in channels.values() if len(logged.ident)]
    if channel is not None or not chosen:
        chosen = [select_channel(path, channels, channel)]
    try:
        return [_bus(logged, bitrate, data_bitrate) for logged in chosen]
    except CanrollError as error:
        raise CanrollError(f"{path}: {error}") from error


def _bus(logged: Logged, bitrate: int | None, data_bitrate: int | None) -> InferredBus:
    switched = bool(logged.data_bits.any())
    if bitrate is None or (switched and data_bitrate is None):
        raise CanrollError(
            f"channel {logged.channel}: a log does not say its bit rate: add it to the file's name,"
            f" as @500000{'/2000000' if switched else ''}"
        )
    data_rate = data_bitrate or 0 if switched else 0
    check_rates(bitrate, data_rate)
    times = queue_times(logged, bitrate, data_rate)
    kinds = logged.flags & (EXTENDED | REMOTE)
    keys = (logged.ident << 2 | kinds)[times.order]
    messages = [_message(logged, times, np.flatnonzero(keys == key)) for key in np.unique(keys)]
    taken = times.end - times.start
    close = np.diff(times.end) < _TOO_CLOSE * taken[1:]
    return InferredBus(
        channel=logged.channel,
        bitrate=bitrate,
        data_bitrate=data_rate,
        too_close=float(close.mean()) if len(close) else 0.0,
        messages=tuple(sorted(messages, key=lambda m: m.message.arbitration_key)),
        recording=recording_of(logged, bitrate=bitrate, data_bitrate=data_rate),
        span_ns=int(times.end[-1] - times.start[0]),
        busy_ns=int(taken.sum()),
    )


def _message(logged: Logged, times: QueueTimes, chosen: NDArray[np.int64]) -> InferredMessage:
    begin = int(times.start[0])
    arrivals = find_arrivals(
        times.earliest[chosen] - begin,
        times.start[chosen] - begin,
        duration_ns=int(times.end[-1]) - begin,
    )
    rows = times.order[chosen]
    lengths = np.unique(logged.length[rows])
    flags = int(np.bitwise_or.reduce(logged.flags[rows]))
    ident = int(logged.ident[rows[0]])
    name = f"{ident:08X}" if flags & EXTENDED else f"{ident:03X}"
    message = BusMessage(
        name=f"Recorded{name}{'R' if flags & REMOTE else ''}",
        ident=ident,
        length=int(lengths[-1]),
        period_ns=arrivals.period,
        sender=RECORDED,
        jitter_ns=arrivals.jitter,
        flags=flags,
        distance_ns=arrivals.distance,
    )
    response = times.end[chosen] - begin - arrivals.releases
    return InferredMessage(
        message,
        len(chosen),
        tuple(map(int, lengths)),
        not arrivals.periodic,
        int(response.max()) if arrivals.periodic else 0,
    )
