"""Worst-case response times of CAN messages.

Davis, Burns, Bril, Lukkien, "Controller Area Network (CAN) schedulability analysis: refuted,
revisited and revised", Real-Time Systems 35 (2007): equations 4 to 11, every instance in the busy
period examined. Response times end behind the interframe space. All arithmetic is exact, in integer
nanoseconds. What the analysis does not cover gets no bound, with the reason: frames of nodes with a
FIFO queue and what such a queue hides, and identifiers that several nodes send. Bounds with an
error model hold as long as no node becomes error-passive.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import duration_ns

ERROR_OVERHEAD_BITS: Final = 31
"""Longest error frame with interframe space and suspend transmission: 12 + 8 + 3 + 8 bits."""
_MAX_STEPS: Final = 200_000
"""Of all fixed points of one message: a busy period this long is all but overload."""
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


@dataclass(frozen=True, slots=True)
class _Task:
    """A message as the analysis sees it; its period is ``above / below`` ns, exactly."""

    key: int
    above: int
    below: int
    jitter: int
    worst: int
    distance: int = 0

    def frames(self, window: int) -> int:
        """Return how many frames can be queued in a half-open window of ``window`` ns."""
        most = -(-(window + self.jitter) * self.below // self.above)
        return min(most, -(-window // self.distance)) if self.distance else most

    def demand(self, window: int) -> int:
        """Return the time on the bus that its frames of a window take at most."""
        return self.frames(window) * self.worst

    @property
    def share(self) -> float:
        """Share of the time that it can keep the bus busy."""
        return self.worst * self.below / self.above


def _task(message: BusMessage, bitrate: int, data_bitrate: int) -> _Task:
    above, below = float(message.period_ns).as_integer_ratio()
    return _Task(
        message.arbitration_key,
        above,
        below,
        # releases at whole nanoseconds: that rounding is jitter, too
        message.jitter_ns + (below != 1),
        message.worst_ns(bitrate, data_bitrate),
        message.distance_ns,
    )


def _obstacles(messages: Sequence[BusMessage]) -> list[tuple[str, bool]]:
    """Return for every message why it can have no bound, empty where it can; and ``covered``."""
    keys = [m.arbitration_key for m in messages]
    nodes: dict[int, list[str]] = {}
    for message, key in zip(messages, keys, strict=True):
        nodes.setdefault(key, []).append(message.sender)
    for message, key in zip(messages, keys, strict=True):
        if len(set(nodes[key])) > 1:
            reason = f"identifier {message.ident:X} used by several nodes: their frames collide"
            return [(reason, True)] * len(messages)
    hidden = {
        node: [k for m, k in zip(messages, keys, strict=True) if m.sender == node]
        for node in dict.fromkeys(m.sender for m in messages if m.fifo)
    }
    found = []
    for message, key in zip(messages, keys, strict=True):
        over = [node for node, mixed in hidden.items() if min(mixed) < key < max(mixed)]
        if len(nodes[key]) > 1:
            found.append((f"identifier {message.ident:X} used twice", True))
        elif message.sender in hidden:
            found.append(("FIFO queue: not covered", False))
        elif over:
            found.append((f"FIFO queue of {over[0]} holds back urgent frames: not covered", False))
        else:
            found.append(("", True))
    return found


def response_bounds(
    messages: Sequence[BusMessage],
    *,
    bitrate: int,
    data_bitrate: int = 0,
    errors: ErrorModel | None = None,
) -> list[ResponseBound]:
    """Return the worst-case response time of every message on one bus.

    Args:
        messages: all periodic messages of the bus; a triggered message's period is its least
            distance.
        bitrate: nominal bit rate, bit/s.
        data_bitrate: of the data phase of FD frames with bit-rate switch, 0: none.
        errors: bounds how often frames are disturbed; None: never.
    """
    tasks = [_task(message, bitrate, data_bitrate) for message in messages]
    bit = int(duration_ns(1, bitrate))
    bounds = []
    obstacles = _obstacles(messages)
    for message, task, (obstacle, covered) in zip(messages, tasks, obstacles, strict=True):
        best = message.best_ns(bitrate, data_bitrate)
        if obstacle:
            bounds.append(ResponseBound(message, best, None, 0, obstacle, covered))
            continue
        higher = [t for t in tasks if t.key < task.key]
        blocking = max((t.worst for t in tasks if t.key > task.key), default=0)
        found, instances = _bound(task, higher, blocking, bit, errors)
        bound, queued = found or (None, None)
        reason = "" if found else OVERLOADED
        bounds.append(ResponseBound(message, best, bound, instances, reason, queued_ns=queued))
    return bounds


def _bound(
    task: _Task, higher: list[_Task], blocking: int, bit: int, errors: ErrorModel | None
) -> tuple[tuple[int, int] | None, int]:
    """Return the responses from the nominal release and from queueing, and the instances."""
    level = [*higher, task]
    longest = max(t.worst for t in level) + ERROR_OVERHEAD_BITS * bit

    def disturbance(window: int) -> int:
        if errors is None:
            return 0
        return (errors.burst - 1 - (-window // errors.interval_ns)) * longest

    used = sum(t.share for t in level)
    used += longest / errors.interval_ns if errors else 0.0
    if used >= 1.0:
        return None, 0
    steps = _MAX_STEPS
    busy, longer = 0, task.worst
    while longer != busy:
        busy = longer
        longer = blocking + disturbance(busy) + sum(t.demand(busy) for t in level)
        steps -= 1
        if steps == 0:
            return None, 0
    instances = task.frames(busy)
    worst = queued = wait = 0
    for instance in range(instances):
        first = blocking + instance * task.worst
        longer, wait = max(wait, first), -1
        while longer != wait:
            wait = longer
            longer = first + disturbance(wait + task.worst)
            longer += sum(t.demand(wait + bit) for t in higher)
            steps -= 1
            if steps == 0:
                return None, instances
        nominal = instance * task.above // task.below
        worst = max(worst, task.jitter + wait - nominal + task.worst)
        earliest = max(nominal - task.jitter, instance * task.distance, 0)
        queued = max(queued, wait - earliest + task.worst)
    return (worst, queued), instances


def worst_case_utilisation(
    messages: Sequence[BusMessage], *, bitrate: int, data_bitrate: int = 0
) -> float:
    """Return the share of time a bus is busy if every frame is as long as it can be."""
    return sum(m.worst_ns(bitrate, data_bitrate) / m.period_ns for m in messages)
