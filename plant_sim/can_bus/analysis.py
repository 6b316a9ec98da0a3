"""Worst-case response times of CAN messages.

Davis, Burns, Bril, Lukkien, "Controller Area Network (CAN) schedulability analysis: refuted,
revisited and revised", Real-Time Systems 35 (2007): equations 4 to 11, every instance in the busy
period examined. Response times end behind the interframe space. All arithmetic in integer
nanoseconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Final

from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import arbitration_key, duration_ns

ERROR_OVERHEAD_BITS: Final = 31
"""Longest error frame with interframe space and suspend transmission: 12 + 8 + 3 + 8 bits."""
_MAX_STEPS: Final = 200_000


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """At most ``burst`` disturbed frames at once, then one in every ``interval_ns``."""

    interval_ns: int
    burst: int = 1


@dataclass(frozen=True, slots=True)
class ResponseBound:
    """Response times of one message from its nominal release, in nanoseconds.

    ``bound_ns`` None: no bound exists (``reason`` says why). ``instances``: how many instances
    in the busy period were examined.
    """

    message: BusMessage
    best_ns: int
    bound_ns: int | None
    instances: int = 0
    reason: str = ""


def _ceil_div(numerator: float, period: float) -> int:
    if isinstance(period, int) or period.is_integer():
        return -(-int(numerator) // int(period))
    return ceil(numerator / period)


@dataclass(frozen=True, slots=True)
class _Task:
    key: int
    period: float
    jitter: int
    worst: int


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
    tasks = [
        _Task(
            arbitration_key(m.ident, m.flags),
            m.period_ns,
            m.jitter_ns,
            m.worst_ns(bitrate, data_bitrate),
        )
        for m in messages
    ]
    bit = int(duration_ns(1, bitrate))
    bounds = []
    for message, task in zip(messages, tasks, strict=True):
        best = message.best_ns(bitrate, data_bitrate)
        if message.fifo:
            bounds.append(ResponseBound(message, best, None, reason="FIFO queue: not covered"))
            continue
        higher = [t for t in tasks if t.key < task.key]
        same = [t for t in tasks if t.key == task.key and t is not task]
        if same:
            bounds.append(ResponseBound(message, best, None, reason="identifier used twice"))
            continue
        blocking = max((t.worst for t in tasks if t.key > task.key), default=0)
        bound, instances = _bound(task, higher, blocking, bit, errors)
        reason = "" if bound is not None else "bus overloaded at this priority"
        bounds.append(ResponseBound(message, best, bound, instances, reason))
    return bounds


def _bound(
    task: _Task, higher: list[_Task], blocking: int, bit: int, errors: ErrorModel | None
) -> tuple[int | None, int]:
    level = [*higher, task]
    longest = max(t.worst for t in level) + ERROR_OVERHEAD_BITS * bit

    def disturbance(window: int) -> int:
        if errors is None:
            return 0
        return (errors.burst - 1 + _ceil_div(window, errors.interval_ns)) * longest

    used = sum(t.worst / t.period for t in level)
    used += longest / errors.interval_ns if errors else 0.0
    if used >= 1.0:
        return None, 0
    busy = task.worst
    for _ in range(_MAX_STEPS):
        longer = blocking + disturbance(busy)
        longer += sum(_ceil_div(busy + t.jitter, t.period) * t.worst for t in level)
        if longer == busy:
            break
        busy = longer
    else:
        return None, 0
    instances = _ceil_div(busy + task.jitter, task.period)
    worst = 0
    wait = 0
    for instance in range(instances):
        wait = max(wait, blocking + instance * task.worst)
        for _ in range(_MAX_STEPS):
            longer = blocking + instance * task.worst + disturbance(wait + task.worst)
            longer += sum(_ceil_div(wait + t.jitter + bit, t.period) * t.worst for t in higher)
            if longer == wait:
                break
            wait = longer
        else:
            return None, instances
        worst = max(worst, task.jitter + wait - int(instance * task.period) + task.worst)
    return worst, instances


def response_bound_1994(
    messages: Sequence[BusMessage], name: str, *, bitrate: int, data_bitrate: int = 0
) -> int | None:
    """Return the bound of the 1994 analysis, which looks at the first instance alone.

    Tindell, Burns, "Guaranteeing message latencies on Controller Area Network" (1994); refuted in
    2007: it can lie below the real worst case. Kept for comparison only.
    """
    message = next(m for m in messages if m.name == name)
    key = arbitration_key(message.ident, message.flags)
    others = [m for m in messages if m.name != name]
    higher = [m for m in others if arbitration_key(m.ident, m.flags) < key]
    lower = [m for m in others if arbitration_key(m.ident, m.flags) > key]
    blocking = max((m.worst_ns(bitrate, data_bitrate) for m in lower), default=0)
    bit = int(duration_ns(1, bitrate))
    worst = message.worst_ns(bitrate, data_bitrate)
    if sum(m.worst_ns(bitrate, data_bitrate) / m.period_ns for m in higher) >= 1.0:
        return None
    wait = blocking
    while True:
        longer = blocking + sum(
            _ceil_div(wait + m.jitter_ns + bit, m.period_ns) * m.worst_ns(bitrate, data_bitrate)
            for m in higher
        )
        if longer == wait:
            return message.jitter_ns + wait + worst
        wait = longer


def worst_case_utilisation(
    messages: Sequence[BusMessage], *, bitrate: int, data_bitrate: int = 0
) -> float:
    """Return the share of time a bus is busy if every frame is as long as it can be."""
    return sum(m.worst_ns(bitrate, data_bitrate) / m.period_ns for m in messages)
