"""From a log to periodic messages: what is on a recorded bus, and the evidence of it."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from plant_sim.can_bus.traffic.arrivals import PERIODIC, Arrivals, find_arrivals
from plant_sim.can_bus.traffic.bit_rate import BitRate, find_bit_rate
from plant_sim.can_bus.traffic.files import Traffic
from plant_sim.can_bus.traffic.log_playback import Recording, recording_of
from plant_sim.can_bus.traffic.log_reader import Logged, read_log, select_channel
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.traffic.queueing import QueueTimes, queue_times
from plant_sim.can_bus.wire.frame import EXTENDED, REMOTE

RECORDED = "Recorded"
"""Node that stands for all senders of a log, which does not name them."""


@dataclass(frozen=True, slots=True)
class InferredMessage:
    """One identifier of a log: as a message, how its frames arrive, and the lengths seen.

    ``seen_ns``: the longest response from the nominal release that the log shows, to the end of
    the interframe space; 0 of an identifier that is not periodic.
    """

    message: BusMessage
    arrivals: Arrivals
    lengths: tuple[int, ...]
    seen_ns: int

    @property
    def assumed(self) -> bool:
        """Whether its curve holds of what was recorded only: nothing limits its frames."""
        return self.arrivals.kind != PERIODIC


@dataclass(frozen=True, slots=True)
class InferredBus:
    """One channel of a log: bit rates, its messages in the order of arbitration, its frames."""

    channel: str
    rate: BitRate
    messages: tuple[InferredMessage, ...]
    recording: Recording
    errors: int

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
) -> InferredBus:
    """Return what is on one channel of a log.

    Args:
        path: a log of a format python-can knows by its suffix.
        channel: as python-can names it; None: the only one with frames.
        bitrate: of the bus, bit/s; None: inferred.
        data_bitrate: of FD frames with bit-rate switch; None: inferred.

    Raises:
        CanrollError: the file cannot be read, has no frame or several channels, or a bit rate can
            neither be inferred nor was given.
        UnknownNameError: it has no such channel.
    """
    logged = select_channel(path, read_log(path), channel)
    return _infer(logged, bitrate, data_bitrate)


def infer_buses(
    path: Path, *, bitrate: int | None = None, data_bitrate: int | None = None
) -> Iterator[InferredBus]:
    """Yield every channel of a log that has frames; see ``infer_bus``."""
    channels = read_log(path)
    select_channel(path, channels, next((c for c, x in channels.items() if len(x.ident)), None))
    for logged in channels.values():
        if len(logged.ident):
            yield _infer(logged, bitrate, data_bitrate)


def _infer(logged: Logged, bitrate: int | None, data_bitrate: int | None) -> InferredBus:
    rate = find_bit_rate(logged, bitrate=bitrate, data_bitrate=data_bitrate)
    times = queue_times(logged, rate)
    kinds = logged.flags & (EXTENDED | REMOTE)
    keys = (logged.ident << 2 | kinds)[times.order]
    found = [_message(logged, times, np.flatnonzero(keys == key)) for key in np.unique(keys)]
    found.sort(key=lambda m: m.message.arbitration_key)
    recording = recording_of(logged, bitrate=rate.nominal, data_bitrate=rate.data)
    return InferredBus(logged.channel, rate, tuple(found), recording, len(logged.errors_ns))


def _message(logged: Logged, times: QueueTimes, chosen: NDArray[np.int64]) -> InferredMessage:
    begin = int(times.start[0])
    start, end = times.start[chosen] - begin, times.end[chosen] - begin
    arrivals = find_arrivals(
        times.earliest[chosen] - begin,
        start,
        times.exact[chosen],
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
        # a release at whole nanoseconds is not to count as the one before
        releases = np.floor((start - arrivals.offset) / arrivals.period + 1e-6)
        seen = int((end - arrivals.offset - releases * arrivals.period).max())
    return InferredMessage(message, arrivals, tuple(map(int, lengths)), seen)
