"""From a log to messages: those on a recorded bus, and their evidence."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from plant_sim.can_bus.traffic.arrivals import PERIODIC, Arrivals, find_arrivals
from plant_sim.can_bus.traffic.bit_rate import BitRate, find_bit_rate
from plant_sim.can_bus.traffic.files import Traffic
from plant_sim.can_bus.traffic.log_playback import RecordedFrames, Recording
from plant_sim.can_bus.traffic.log_reader import Logged, Progress, read_log, select_channel
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.traffic.queueing import QueueTimes, queue_times
from plant_sim.can_bus.wire.frame import EXTENDED, REMOTE

RECORDED = "Recorded"
"""Node that represents all senders of a log, which does not name them."""


@dataclass(frozen=True, slots=True)
class InferredMessage:
    """One identifier of a log: as a message, how its frames arrive, and the lengths seen.

    ``seen_ns``: the longest recorded response from the nominal release to the end of the interframe
    space; 0 for an identifier that is not periodic.
    """

    message: BusMessage
    arrivals: Arrivals
    lengths: tuple[int, ...]
    seen_ns: int

    @property
    def assumed(self) -> bool:
        """Whether its curve holds only for the recording, because it is sent on events."""
        return self.arrivals.kind != PERIODIC


@dataclass(frozen=True, slots=True)
class InferredBus:
    """One channel of a log: bit rates, its messages in the order of arbitration, its frames.

    The frames of ``recording`` are queued early enough for the jitter of their messages, and no
    later than in the log. ``span_ns``: from the start of the first frame to the end of the last;
    ``errors``: number of error frames in the log; ``remarks``: what was left out of it.
    """

    channel: str
    rate: BitRate
    messages: tuple[InferredMessage, ...]
    recording: Recording
    errors: int
    span_ns: int
    busy_ns: int
    remarks: tuple[str, ...] = ()

    @property
    def load(self) -> float:
        """Bus load of the recorded frames, 0 to 1."""
        return self.busy_ns / self.span_ns

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was left out of the log, and which rate is assumed."""
        assumed = self.rate.assumption
        return (*self.remarks, *((f"channel {self.channel}: {assumed}",) if assumed else ()))

    @property
    def traffic(self) -> Traffic:
        """The messages as a traffic set."""
        messages = tuple(m.message for m in self.messages)
        return Traffic(self.rate.nominal, self.rate.data, messages)


def infer_bus(
    path: Path,
    *,
    channel: str | None = None,
    bitrate: int | None = None,
    data_bitrate: int | None = None,
    section: int | None = None,
    progress: Progress | None = None,
) -> InferredBus:
    """Return the messages of one channel of a log, with bit rates and evidence.

    Args:
        path: a log of a format python-can knows by its suffix.
        channel: as python-can names it; None: the only one with frames.
        bitrate: of the bus, bit/s; None: inferred, or assumed without evidence.
        data_bitrate: of FD frames with bit-rate switch; None: likewise.
        section: of a log whose times step, see ``read_log``.
        progress: called with the activity and the fraction done.

    Raises:
        CanrollError: the file cannot be read, has no frame or several channels, or a bit rate is
            neither given nor can be inferred.
        UnknownNameError: it has no such channel.
    """
    channels = read_log(path, section=section, progress=progress)
    logged = select_channel(path, channels, channel)
    try:
        return infer_channel(logged, bitrate, data_bitrate)
    except CanrollError as error:
        raise CanrollError(f"{path}: {error}") from error


def infer_buses(
    path: Path,
    *,
    bitrate: int | None = None,
    data_bitrate: int | None = None,
    section: int | None = None,
    progress: Progress | None = None,
) -> list[InferredBus]:
    """Return every channel of a log that has frames; see ``infer_bus``.

    Raises:
        CanrollError: as there; it names every channel whose bit rate is missing.
    """
    channels = read_log(path, section=section, progress=progress)
    select_channel(path, channels, next((c for c, x in channels.items() if len(x.ident)), None))
    buses, missing = [], []
    for logged in channels.values():
        if len(logged.ident):
            try:
                buses.append(infer_channel(logged, bitrate, data_bitrate))
            except CanrollError as error:
                missing.append(str(error))
    if missing:
        raise CanrollError(f"{path}: {'; '.join(missing)}")
    return buses


def infer_channel(
    logged: Logged, bitrate: int | None = None, data_bitrate: int | None = None
) -> InferredBus:
    """Return the messages of a channel that has been read; see ``infer_bus``."""
    rate = find_bit_rate(logged, bitrate=bitrate, data_bitrate=data_bitrate)
    times = queue_times(logged, rate)
    kinds = logged.flags & (EXTENDED | REMOTE)
    keys = (logged.ident << 2 | kinds)[times.order]
    queued = times.start.copy()
    inferred = []
    for key in np.unique(keys):
        chosen = np.flatnonzero(keys == key)
        message = _message(logged, times, chosen)
        inferred.append(message)
        queued[chosen] = _releases(message, times.start[chosen] - times.start[0])
    inferred.sort(key=lambda m: m.message.arbitration_key)
    order = np.argsort(queued, kind="stable")
    rows = times.order[order]
    frames = RecordedFrames(
        queued[order],
        logged.ident[rows],
        logged.flags[rows],
        logged.length[rows],
        logged.payload[rows],
    )
    duration = int(logged.received_ns[-1] - logged.received_ns[0]) * 1e-9
    return InferredBus(
        channel=logged.channel,
        rate=rate,
        messages=tuple(inferred),
        recording=Recording(frames, logged.channel, round(duration, 6)),
        errors=len(logged.errors_ns),
        span_ns=int(times.end[-1] - times.start[0]),
        busy_ns=int((times.end - times.start).sum()),
        remarks=logged.remarks,
    )


def _releases(inferred: InferredMessage, start: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the queueing times of frames with these starts, within the jitter, ns."""
    if inferred.assumed:
        return start
    nominal = inferred.arrivals.offset + _place(inferred.arrivals, start) * inferred.arrivals.period
    latest = np.floor(nominal + inferred.arrivals.jitter).astype(np.int64)
    return np.maximum(np.minimum(start, latest), 0)


def _place(arrivals: Arrivals, start: NDArray[np.int64]) -> NDArray[np.float64]:
    # a release at whole nanoseconds is not to count as the one before
    return np.floor((start - arrivals.offset) / arrivals.period + 1e-6)


def _message(logged: Logged, times: QueueTimes, chosen: NDArray[np.int64]) -> InferredMessage:
    begin = int(times.start[0])
    start, end = times.start[chosen] - begin, times.end[chosen] - begin
    arrivals = find_arrivals(
        times.earliest[chosen] - begin,
        start,
        times.exact[chosen],
        cuts=logged.cuts_ns - begin,
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
        offset_ns=arrivals.offset,
        flags=flags,
        distance_ns=arrivals.distance,
    )
    seen = 0
    if arrivals.kind == PERIODIC:
        nominal = arrivals.offset + _place(arrivals, start) * arrivals.period
        seen = int((end - nominal).max())
    return InferredMessage(message, arrivals, tuple(map(int, lengths)), seen)
