"""Distance of a set of messages from a missed deadline, in load and in random errors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from plant_sim.can_bus.bounds.analysis import ErrorModel, ResponseBound, worst_case_utilisation
from plant_sim.can_bus.traffic.messages import BusMessage

Bounds = Callable[[Sequence[BusMessage], ErrorModel | None], Sequence[ResponseBound]]
"""``response_bounds`` of one bus."""
_ACCURACY: Final = 1e-3
_LEAST_FACTOR: Final = 1e-3
_MOST_ERRORS: Final = 1000
_ALWAYS: Final = 1 << 60
"""Interval of an error model without errors after its burst: exceeds any busy period, ns."""


def late(bounds: Sequence[ResponseBound]) -> list[str]:
    """Return the messages that have no bound or one above their deadline."""
    return [b.message.name for b in bounds if b.bound_ns is None or b.bound_ns > b.message.due_ns]


@dataclass(frozen=True, slots=True)
class Breakdown:
    """Greatest factor on the rate of all messages with which every deadline is met.

    ``utilisation``: load with the longest frames at that factor; ``first``: messages that miss
    their deadline next. Below 1, a deadline is already missed; at 0, one is missed at any rate.
    """

    factor: float
    utilisation: float
    first: tuple[str, ...]


def breakdown(
    messages: Sequence[BusMessage], bounds: Bounds, *, bitrate: int, data_bitrate: int = 0
) -> Breakdown:
    """Return the breakdown of a set with unchanged deadlines and jitter.

    Bisection to a thousandth, up to a load of 1 with the longest frames.
    """
    load = worst_case_utilisation(messages, bitrate=bitrate, data_bitrate=data_bitrate)
    low, high = 0.0, 1.0 / load
    fallen = late(bounds(_faster(messages, high), None))
    while high - low > _ACCURACY * high and high > _LEAST_FACTOR:
        middle = 0.5 * (low + high)
        missed = late(bounds(_faster(messages, middle), None))
        if missed:
            high, fallen = middle, missed
        else:
            low = middle
    return Breakdown(low, low * load, tuple(fallen))


def _faster(messages: Sequence[BusMessage], factor: float) -> list[BusMessage]:
    return [
        replace(m, period_ns=float(max(round(m.period_ns / factor), 1)), deadline_ns=m.due_ns)
        for m in messages
    ]


@dataclass(frozen=True, slots=True)
class ErrorTolerance:
    """Errors that a message tolerates, and the probability of more.

    ``errors``: disturbed frames in one busy period with which the deadline is still met, −1: missed
    without any. ``probability``: upper bound of missing it, per frame.
    """

    message: BusMessage
    errors: int
    probability: float


def error_tolerance(
    messages: Sequence[BusMessage], bounds: Bounds, *, errors_per_s: float
) -> list[ErrorTolerance]:
    """Return the probability of missed deadlines if errors are a Poisson process.

    A frame is late only if more errors than it tolerates occur between the beginning of its busy
    period and its deadline (Navet, Song, Simonot, "Worst-case deadline failure probability in
    real-time applications distributed over CAN", J. Systems Architecture 46, 2000). Each error
    costs the longest error frame and the longest frame of that priority.
    """
    left = list(range(len(messages)))
    survived = [-1] * len(messages)
    window = [m.due_ns + m.jitter_ns for m in messages]
    for count in range(_MOST_ERRORS):
        model = ErrorModel(_ALWAYS, count) if count else None
        answers = bounds(messages, model)
        left = [i for i in left if not late([answers[i]])]
        for i in left:
            survived[i] = count
            # the last instance that was looked at is released so long after the busy period began
            before = (answers[i].instances - 1) * int(messages[i].period_ns)
            window[i] = max(window[i], messages[i].due_ns + max(before, 0))
        if not left:
            break
    # a sixth of a second that only this needs
    from scipy.special import pdtrc  # noqa: PLC0415

    return [
        ErrorTolerance(m, k, 1.0 if k < 0 else float(pdtrc(k, errors_per_s * w * 1e-9)))
        for m, k, w in zip(messages, survived, window, strict=True)
    ]
