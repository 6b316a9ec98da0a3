"""Bus time that the frames of a message or of a node can take in a window of time."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import lcm
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.can_bus.traffic.messages import BusMessage

_MOST_RELEASES: Final = 4000
"""Releases of one node in its hyperperiod; with more, its offsets are ignored."""


class Demand(Protocol):
    """Interference on a message: bus time in a window, ns."""

    @property
    def worst(self) -> int:
        """Longest frame, ns."""

    @property
    def share(self) -> float:
        """Bus load, 0 to 1 or more."""

    def demand(self, window: int) -> int:
        """Return the greatest bus time of the frames queued in a half-open window, both in ns."""


@dataclass(frozen=True, slots=True)
class MessageDemand:
    """A message as analysed, times in ns; its exact period is ``above / below``."""

    key: int
    above: int
    below: int
    jitter: int
    worst: int
    distance: int = 0
    offset: int = 0

    def frames(self, window: int) -> int:
        """Return the greatest number of frames queued in a half-open window of ``window`` ns."""
        most = -(-(window + self.jitter) * self.below // self.above)
        return min(most, -(-window // self.distance)) if self.distance else most

    def demand(self, window: int) -> int:
        """Return the greatest bus time of the frames queued in a half-open window, both in ns."""
        return self.frames(window) * self.worst

    def earliest(self, number: int) -> int:
        """Return the earliest queueing of frame ``number``, ns after that of frame 0."""
        nominal = -(-number * self.above // self.below)
        return max(0, nominal - self.jitter, number * self.distance)

    @property
    def share(self) -> float:
        """Bus load, 0 to 1 or more."""
        return self.worst * self.below / self.above


@dataclass(frozen=True, slots=True)
class OffsetDemand:
    """Messages of one node that keep their offsets, so that they cannot all be queued at once.

    The maximum over the windows that begin at the latest queueing of any frame of the hyperperiod
    (transactions of Tindell 1994, Palencia and González Harbour 1998).
    """

    tasks: Sequence[MessageDemand]
    _starts: NDArray[np.int64] = field(init=False, repr=False)
    _known: dict[int, int] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Compute the starts of the windows."""
        span = lcm(*(task.above for task in self.tasks))
        starts = [
            (task.offset + task.jitter + np.arange(span // task.above) * task.above) % span
            for task in self.tasks
        ]
        object.__setattr__(self, "_starts", np.unique(np.concatenate(starts)))

    @property
    def worst(self) -> int:
        """Longest frame, ns."""
        return max(task.worst for task in self.tasks)

    @property
    def share(self) -> float:
        """Bus load of the node, 0 to 1 or more."""
        return sum(task.share for task in self.tasks)

    def demand(self, window: int) -> int:
        """Return the greatest bus time of the frames queued in a half-open window, both in ns."""
        if window <= 0:
            return 0
        if window not in self._known:
            total = np.zeros(len(self._starts), np.int64)
            for task in self.tasks:
                first = self._starts - task.offset
                last = -(-(first + window) // task.above)
                total += (last - -(-(first - task.jitter) // task.above)) * task.worst
            plain = sum(task.demand(window) for task in self.tasks)
            self._known[window] = min(int(total.max()), plain)
        return self._known[window]


def with_offsets(tasks: Sequence[tuple[str, MessageDemand]]) -> list[Demand]:
    """Return the demand of (node, message) pairs, joined by node if its offsets can be used.

    They cannot if a period of the node is not a whole number of nanoseconds, or if the hyperperiod
    has too many releases.
    """
    demands: list[Demand] = []
    nodes: dict[str, list[MessageDemand]] = {}
    for node, task in tasks:
        nodes.setdefault(node, []).append(task)
    for own in nodes.values():
        integers = all(task.below == 1 for task in own)
        span = lcm(*(task.above for task in own)) if integers else 0
        releases = sum(span // task.above for task in own)
        if integers and len(own) > 1 and releases <= _MOST_RELEASES:
            demands.append(OffsetDemand(own))
        else:
            demands += own
    return demands


def task_of(
    message: BusMessage, bitrate: int, data_bitrate: int, waiting: int = 0
) -> MessageDemand:
    """Return a message as analysed; ``waiting``: ns in a queue before arbitration."""
    above, below = float(message.period_ns).as_integer_ratio()
    return MessageDemand(
        message.arbitration_key,
        above,
        below,
        # releases at whole nanoseconds: that rounding is jitter, too
        message.jitter_ns + waiting + (below != 1),
        message.worst_ns(bitrate, data_bitrate),
        0 if waiting else message.distance_ns,
        message.offset_ns,
    )
