"""Queueing times of the frames of a log, inferred from the traffic on the bus.

A frame that starts on an idle bus was queued at that instant. One that follows another frame
without a pause has waited, at the earliest since the busy period began, and since the start of the
last frame before it with lower priority. This holds for frames that take part in arbitration as
soon as they are queued; a frame held in a node's own queue counts as queued when it reaches the
front.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.can_bus.traffic.log_playback import start_times
from canroll.plant_sim.can_bus.traffic.log_reader import Logged, transmission_times
from canroll.plant_sim.can_bus.wire.frame import arbitration_key, duration_ns, worst_case_bits

_STAMP_NS = 2_000
"""Greatest error of the difference of two time stamps of whole microseconds, ns."""
_PAUSE_BITS = 3
"""Shorter pauses are ignored, because of sampling delay and clock differences."""


class QueueTimes(NamedTuple):
    """Frames of a log in the order of their starts, one entry per frame, times in ns.

    Each was queued between ``earliest`` and ``start`` of its transmission, on an idle bus at
    ``start``. ``end``: of its interframe space. ``order``: its index in the log.
    """

    order: NDArray[np.int64]
    earliest: NDArray[np.int64]
    start: NDArray[np.int64]
    end: NDArray[np.int64]


def queue_times(logged: Logged, bitrate: int, data_bitrate: int) -> QueueTimes:
    """Return the interval in which every frame of a channel was queued."""
    started = start_times(logged, bitrate=bitrate, data_bitrate=data_bitrate)
    order = np.argsort(started, kind="stable")
    start = started[order]
    taken = transmission_times(logged.nominal_bits, logged.data_bits, bitrate, data_bitrate)
    end = start + taken[order]
    pairs = zip(logged.ident[order].tolist(), logged.flags[order].tolist(), strict=True)
    keys = [int(arbitration_key(ident, flags)) for ident, flags in pairs]
    pause = _STAMP_NS + int(duration_ns(_PAUSE_BITS, bitrate))
    broken = int(duration_ns(worst_case_bits(8, 1)[0], bitrate))
    idle = np.r_[True, start[1:] - end[:-1] > pause]
    errors = np.searchsorted(logged.errors_ns, start)
    disturbed = np.r_[errors[:1] > 0, np.diff(errors) > 0]
    earliest = start.copy()
    first = 0
    floor = 0
    for i in range(len(start)):
        if idle[i]:
            first, floor = i, int(start[i])
            if disturbed[i]:
                # what the error destroyed was this frame, and began no longer ago than it can last
                before = int(errors[i - 1]) if i else 0
                floor = int(logged.errors_ns[before]) - broken
                floor = max(floor, int(end[i - 1])) if i else floor
        at = i - 1
        while at >= first and keys[at] <= keys[i]:
            at -= 1
        earliest[i] = start[at] if at >= first else min(floor, int(start[i]))
    return QueueTimes(order, earliest, start, end)
