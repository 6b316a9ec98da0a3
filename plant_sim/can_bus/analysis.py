"""Worst-case response times of CAN messages.

Davis, Burns, Bril, Lukkien, "Controller Area Network (CAN) schedulability analysis: refuted,
revisited and revised", Real-Time Systems 35 (2007): equations 4 to 11, every instance in the busy
period examined. Response times end behind the interframe space. All arithmetic is exact, in integer
nanoseconds. First-in first-out queues: after Davis, Kollmann, Pollex, Slomka, "Schedulability
analysis for Controller Area Network (CAN) with FIFO queues, priority queues and gateways",
Real-Time Systems 49 (2013). Identifiers that several nodes send have no bound. Bounds with an error
model hold as long as no node becomes error-passive.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from plant_sim.can_bus.demand import Demand, Task, task_of, with_offsets
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import duration_ns

ERROR_OVERHEAD_BITS: Final = 31
"""Longest error frame with interframe space and suspend transmission: 12 + 8 + 3 + 8 bits."""
_MAX_STEPS: Final = 200_000
"""Of all fixed points of one message: a busy period this long is all but overload."""
_MAX_ROUNDS: Final = 200
"""Of the waiting in FIFO queues; with more their analysis diverges."""
OVERLOADED: Final = "bus overloaded at this priority"


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """At most ``burst`` disturbed frames at once, then one in every ``interval_ns``."""

    interval_ns: int
    burst: int = 1


@dataclass(frozen=True, slots=True)
class ResponseBound:
    """Response times of one message from its nominal release, in nanoseconds.

    ``bound_ns`` None: there is none, and ``reason`` says why; ``covered``: because the set has no
    bound (overload, identifiers used twice), not because the analysis does not cover it.
    ``instances``: how many instances in the busy period were examined. ``queued_ns``: likewise from
    the instant of queueing, whatever the jitter before.
    """

    message: BusMessage
    best_ns: int
    bound_ns: int | None
    instances: int = 0
    reason: str = ""
    covered: bool = True
    queued_ns: int | None = None


def _obstacles(messages: Sequence[BusMessage]) -> list[str]:
    """Return for every message why it can have no bound, empty where it can."""
    keys = [m.arbitration_key for m in messages]
    nodes: dict[int, list[str]] = {}
    for message, key in zip(messages, keys, strict=True):
        nodes.setdefault(key, []).append(message.sender)
    for message, key in zip(messages, keys, strict=True):
        if len(set(nodes[key])) > 1:
            reason = f"identifier {message.ident:X} used by several nodes: their frames collide"
            return [reason] * len(messages)
    twice = (len(nodes[key]) > 1 for key in keys)
    return [
        f"identifier {m.ident:X} used twice" if t else ""
        for m, t in zip(messages, twice, strict=True)
    ]


def response_bounds(
    messages: Sequence[BusMessage],
    *,
    bitrate: int,
    data_bitrate: int = 0,
    errors: ErrorModel | None = None,
    offsets: bool = False,
    unlimited: Collection[int] = (),
) -> list[ResponseBound]:
    """Return the worst-case response time of every message on one bus.

    A frame in a first-in first-out queue competes only when it is the oldest there: what has waited
    longest in it adds to its jitter towards all others, until nothing changes.

    Args:
        messages: all periodic messages of the bus; a triggered message's period is its least
            distance. A sender with one FIFO message queues all of its messages so.
        bitrate: nominal bit rate, bit/s.
        data_bitrate: of the data phase of FD frames with bit-rate switch, 0: none.
        errors: bounds how often frames are disturbed; None: never.
        offsets: the messages of one node keep their offsets; otherwise all may come at once.
        unlimited: places in ``messages`` of those whose jitter has no limit.
    """
    fifo = {m.sender for m in messages if m.fifo}
    queues = {s: [i for i, m in enumerate(messages) if m.sender == s] for s in fifo}
    waiting: dict[int, int | None] = {i: 0 for queue in queues.values() for i in queue}
    waiting |= dict.fromkeys(unlimited)
    found: list[_Found] = []
    for _ in range(_MAX_ROUNDS):
        level = _Round(messages, waiting, bitrate, data_bitrate, errors, offsets)
        found = [
            level.of_queue(i, queues[m.sender]) if m.sender in fifo else level.of(i)
            for i, m in enumerate(messages)
        ]
        now = {i: level.waits(i, found[i]) for i in waiting}
        if now == waiting:
            break
        waiting = now
    else:
        found = [(None, 0)] * len(messages)
    bounds = []
    for message, obstacle, (answer, instances) in zip(
        messages, _obstacles(messages), found, strict=True
    ):
        best = message.best_ns(bitrate, data_bitrate)
        if obstacle or answer is None:
            bounds.append(ResponseBound(message, best, None, 0, obstacle or OVERLOADED))
        else:
            bounds.append(ResponseBound(message, best, answer[0], instances, queued_ns=answer[1]))
    return bounds


_Found = tuple[tuple[int, int] | None, int]
"""Responses from the nominal release and from queueing, None: unbounded; instances examined."""


@dataclass(frozen=True, slots=True)
class _Round:
    """One round of the analysis: ``waiting`` in FIFO queues is known, None: without limit."""

    messages: Sequence[BusMessage]
    waiting: Mapping[int, int | None]
    bitrate: int
    data_bitrate: int
    errors: ErrorModel | None
    offsets: bool
    own: list[Task] = field(init=False)
    others: list[Task] = field(init=False)

    def __post_init__(self) -> None:
        """Take every message as it is, and as others see it."""
        rates = self.bitrate, self.data_bitrate
        waits = [self.waiting.get(i) or 0 for i in range(len(self.messages))]
        own = [task_of(m, *rates) for m in self.messages]
        others = [task_of(m, *rates, w) for m, w in zip(self.messages, waits, strict=True)]
        object.__setattr__(self, "own", own)
        object.__setattr__(self, "others", others)

    def waits(self, place: int, found: _Found) -> int | None:
        """Return how long a frame may wait in its queue until its transmission begins."""
        return None if found[0] is None else found[0][1] - self.own[place].worst

    def of(self, place: int) -> _Found:
        """Return the bound of a message that competes as soon as it is queued."""
        level = self._level([place])
        return (None, 0) if level is None else _bound(self.own[place], level)

    def of_queue(self, place: int, queue: Sequence[int]) -> _Found:
        """Return the bound of a message in a FIFO queue, which is as urgent as its least one."""
        level = self._level(queue)
        return (None, 0) if level is None else _queue_bound(self.own[place], level)

    def _level(self, queue: Sequence[int]) -> "_Level | None":
        """Return the level of priority of these messages; None: what is above has no bound."""
        own = [self.own[i] for i in queue]
        lowest = max(t.key for t in own)
        chosen = [i for i, t in enumerate(self.others) if t.key < lowest and i not in queue]
        if any(self.waiting.get(i, 0) is None for i in (*chosen, *queue)):
            return None
        blocking = max((t.worst for t in self.own if t.key > lowest), default=0)
        higher: Sequence[Demand] = [self.others[i] for i in chosen]
        if self.offsets:
            higher = with_offsets([(self.messages[i].sender, self.others[i]) for i in chosen])
        return _Level(higher, own, blocking, int(duration_ns(1, self.bitrate)), self.errors)


@dataclass(slots=True)
class _Level:
    """A level of priority: the messages that keep the bus busy, and what errors add."""

    higher: Sequence[Demand]
    own: Sequence[Task]
    blocking: int
    bit: int
    errors: ErrorModel | None
    _steps: int = _MAX_STEPS

    @property
    def _longest(self) -> int:
        """Return what one error costs at most, ns."""
        return max(t.worst for t in (*self.higher, *self.own)) + ERROR_OVERHEAD_BITS * self.bit

    @property
    def overloaded(self) -> bool:
        """Whether the level can keep the bus busy for ever."""
        lost = self._longest / self.errors.interval_ns if self.errors else 0.0
        return sum(t.share for t in (*self.higher, *self.own)) + lost >= 1.0

    def _disturbance(self, window: int) -> int:
        if self.errors is None:
            return 0
        count = self.errors.burst - 1 - (-window // self.errors.interval_ns)
        return count * self._longest

    def busy(self) -> int | None:
        """Return the longest time that the level keeps the bus busy; None: practically for ever."""
        busy, longer = 0, self.own[0].worst
        while longer != busy:
            busy = longer
            longer = self.blocking + self._disturbance(busy)
            longer += sum(t.demand(busy) for t in (*self.higher, *self.own))
            if not self._step():
                return None
        return busy

    def start(self, before: int, worst: int, least: int) -> int | None:
        """Return the latest start of a frame behind blocking and ``before`` ns of its own level.

        Args:
            before: of frames that are sent before it.
            worst: its longest transmission.
            least: it begins no sooner, as has been found before.
        """
        first = self.blocking + before
        longer, wait = max(least, first), -1
        while longer != wait:
            wait = longer
            longer = first + self._disturbance(wait + worst)
            longer += sum(t.demand(wait + self.bit) for t in self.higher)
            if not self._step():
                return None
        return wait

    def _step(self) -> bool:
        self._steps -= 1
        return self._steps > 0


def _bound(task: Task, level: _Level) -> _Found:
    busy = None if level.overloaded else level.busy()
    if busy is None:
        return None, 0
    instances = task.frames(busy)
    worst = queued = wait = 0
    for instance in range(instances):
        start = level.start(instance * task.worst, task.worst, wait)
        if start is None:
            return None, instances
        wait = start
        nominal = instance * task.above // task.below
        worst = max(worst, task.jitter + wait - nominal + task.worst)
        queued = max(queued, wait - task.earliest(instance) + task.worst)
    return (worst, queued), instances


def _queue_bound(task: Task, level: _Level) -> _Found:
    """Bound a message behind all frames of its queue that came no later.

    The queue is one level of priority, that of its least urgent message, served in order. The
    longest response begins at an instant at which some message of the queue can bring one more.
    """
    group = level.own
    busy = None if level.overloaded else level.busy()
    if busy is None:
        return None, 0
    arrivals = sorted({t.earliest(k) for t in group for k in range(t.frames(busy))})
    queued = wait = 0
    for arrival in arrivals:
        before = sum(t.demand(arrival + 1) for t in group) - task.worst
        start = level.start(before, task.worst, wait)
        if start is None:
            return None, len(arrivals)
        wait = start
        queued = max(queued, wait + task.worst - arrival)
    return (queued + task.jitter, queued), len(arrivals)


def worst_case_utilisation(
    messages: Sequence[BusMessage], *, bitrate: int, data_bitrate: int = 0
) -> float:
    """Return the share of time a bus is busy if every frame is as long as it can be."""
    return sum(m.worst_ns(bitrate, data_bitrate) / m.period_ns for m in messages)
