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

from canroll.plant_sim.can_bus.bounds.demand import Demand, MessageDemand, task_of, with_offsets
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import transmission_ns

ERROR_OVERHEAD_BITS: Final = 31
"""Longest error frame with interframe space and suspend transmission: 12 + 8 + 3 + 8 bits."""
_MAX_STEPS: Final = 200_000
"""Iterations for one message; a longer busy period is treated as overload."""
_MAX_ROUNDS: Final = 200
"""Iterations over the waiting times in FIFO queues; more are treated as divergence."""
OVERLOADED: Final = "bus overloaded at this priority"


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """At most ``burst`` disturbed frames at once, then one per ``interval_ns``."""

    interval_ns: int
    burst: int = 1


@dataclass(frozen=True, slots=True)
class ResponseBound:
    """Response times of one message from its nominal release, in nanoseconds.

    ``bound_ns`` is None if there is no bound; ``reason`` gives the cause, and ``covered`` is False
    if the analysis does not apply, True if the set itself is unbounded (overload, duplicate
    identifiers). ``instances``: number of instances examined in the busy period. ``queued_ns``:
    bound from the instant of queueing, without the jitter before it.
    """

    message: BusMessage
    best_ns: int
    bound_ns: int | None
    instances: int = 0
    reason: str = ""
    covered: bool = True
    queued_ns: int | None = None


def _obstacles(messages: Sequence[BusMessage]) -> list[str]:
    """Return the reason why each message has no bound, empty if it can have one."""
    keys = [m.arbitration_key for m in messages]
    nodes: dict[int, list[str]] = {}
    for message, key in zip(messages, keys, strict=True):
        nodes.setdefault(key, []).append(message.sender)
    for message, key in zip(messages, keys, strict=True):
        if len(set(nodes[key])) > 1:
            reason = f"identifier 0x{message.ident:X} used by several nodes: their frames collide"
            return [reason] * len(messages)
    twice = (len(nodes[key]) > 1 for key in keys)
    return [
        f"identifier 0x{m.ident:X} used twice" if t else ""
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

    A frame in a first-in first-out queue takes part in arbitration only when it is the oldest. The
    longest waiting time in the queue is therefore added to its jitter as interference on others,
    and the analysis is repeated until no waiting time changes.

    Args:
        messages: all periodic messages of the bus; the period of a triggered message is its minimum
            distance. If one message of a sender is FIFO, all messages of that sender are.
        bitrate: nominal bit rate, bit/s.
        data_bitrate: of the data phase of FD frames with bit-rate switch, bit/s; 0: none.
        errors: limit on the number of disturbed frames; None: no errors.
        offsets: whether the messages of one node keep their offsets; otherwise all may be queued
            at once.
        unlimited: indices in ``messages`` of those with unlimited jitter.
    """
    fifo = {m.sender for m in messages if m.fifo}
    queues = {s: [i for i, m in enumerate(messages) if m.sender == s] for s in fifo}
    waiting: dict[int, int | None] = {i: 0 for queue in queues.values() for i in queue}
    waiting |= dict.fromkeys(unlimited)
    intervals: list[_Interval] = []
    for _ in range(_MAX_ROUNDS):
        level = _Round(messages, waiting, bitrate, data_bitrate, errors, offsets)
        intervals = [
            level.of_queue(i, queues[m.sender]) if m.sender in fifo else level.of(i)
            for i, m in enumerate(messages)
        ]
        now = {i: level.waits(i, intervals[i]) for i in waiting}
        if now == waiting:
            break
        waiting = now
    else:
        intervals = [(None, 0)] * len(messages)
    bounds = []
    for message, obstacle, (answer, instances) in zip(
        messages, _obstacles(messages), intervals, strict=True
    ):
        best = message.best_ns(bitrate, data_bitrate)
        if obstacle or answer is None:
            bounds.append(ResponseBound(message, best, None, 0, obstacle or OVERLOADED))
        else:
            bounds.append(ResponseBound(message, best, answer[0], instances, queued_ns=answer[1]))
    return bounds


_Interval = tuple[tuple[int, int] | None, int]
"""Bounds from the nominal release and from queueing, ns, None if unbounded; instances examined."""


@dataclass(frozen=True, slots=True)
class _Round:
    """One round of the analysis with known waiting times in queues, ns; None: unlimited."""

    messages: Sequence[BusMessage]
    waiting: Mapping[int, int | None]
    bitrate: int
    data_bitrate: int
    errors: ErrorModel | None
    offsets: bool
    own: list[MessageDemand] = field(init=False)
    others: list[MessageDemand] = field(init=False)

    def __post_init__(self) -> None:
        """Describe every message as analysed, and as interference on others."""
        rates = self.bitrate, self.data_bitrate
        waits = [self.waiting.get(i) or 0 for i in range(len(self.messages))]
        own = [task_of(m, *rates) for m in self.messages]
        others = [task_of(m, *rates, w) for m, w in zip(self.messages, waits, strict=True)]
        object.__setattr__(self, "own", own)
        object.__setattr__(self, "others", others)

    def waits(self, place: int, bound: _Interval) -> int | None:
        """Return the longest time from queueing to the start of transmission, ns, if bounded."""
        return None if bound[0] is None else bound[0][1] - self.own[place].worst

    def of(self, place: int) -> _Interval:
        """Return the bound of a message that takes part in arbitration as soon as it is queued."""
        level = self._level([place])
        return (None, 0) if level is None else _bound(self.own[place], level)

    def of_queue(self, place: int, queue: Sequence[int]) -> _Interval:
        """Return the bound of a message in a FIFO queue, with the priority of its lowest one."""
        level = self._level(queue)
        return (None, 0) if level is None else _queue_bound(self.own[place], level)

    def _level(self, queue: Sequence[int]) -> "_Level | None":
        """Return the priority level of these messages; None if a higher one is unbounded."""
        own = [self.own[i] for i in queue]
        lowest = max(t.key for t in own)
        chosen = [i for i, t in enumerate(self.others) if t.key < lowest and i not in queue]
        if any(self.waiting.get(i, 0) is None for i in (*chosen, *queue)):
            return None
        blocking = max((t.worst for t in self.own if t.key > lowest), default=0)
        higher: Sequence[Demand] = [self.others[i] for i in chosen]
        if self.offsets:
            higher = with_offsets([(self.messages[i].sender, self.others[i]) for i in chosen])
        return _Level(
            higher, own, blocking, transmission_ns((1, 0), bitrate=self.bitrate), self.errors
        )


@dataclass(slots=True)
class _Level:
    """A priority level: its messages, those of higher priority, blocking, and errors."""

    higher: Sequence[Demand]
    own: Sequence[MessageDemand]
    blocking: int
    bit: int
    errors: ErrorModel | None
    _steps: int = _MAX_STEPS

    @property
    def _longest(self) -> int:
        """Longest time lost by one error, ns."""
        return max(t.worst for t in (*self.higher, *self.own)) + ERROR_OVERHEAD_BITS * self.bit

    @property
    def overloaded(self) -> bool:
        """Whether the level can keep the bus busy forever."""
        lost = self._longest / self.errors.interval_ns if self.errors else 0.0
        return sum(t.share for t in (*self.higher, *self.own)) + lost >= 1.0

    def _disturbance(self, window: int) -> int:
        if self.errors is None:
            return 0
        count = self.errors.burst - 1 - (-window // self.errors.interval_ns)
        return count * self._longest

    def busy(self) -> int | None:
        """Return the longest busy period of the level, ns; None if it is practically endless."""
        busy, longer = 0, self.own[0].worst
        while longer != busy:
            busy = longer
            longer = self.blocking + self._disturbance(busy)
            longer += sum(t.demand(busy) for t in (*self.higher, *self.own))
            if not self._step():
                return None
        return busy

    def start(self, before: int, worst: int, least: int) -> int | None:
        """Return the latest start of a frame behind blocking and ``before`` ns of its level.

        Args:
            before: transmission time of the frames sent before it, ns.
            worst: its longest transmission, ns.
            least: known lower bound of the result, ns.
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


def _bound(task: MessageDemand, level: _Level) -> _Interval:
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


def _queue_bound(task: MessageDemand, level: _Level) -> _Interval:
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
    """Return the bus load, 0 to 1 or more, if every frame has its greatest length."""
    return sum(m.worst_ns(bitrate, data_bitrate) / m.period_ns for m in messages)
