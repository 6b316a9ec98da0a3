"""Response times on a recorded bus, without and with additional messages."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from plant_sim.can_bus.analysis import ErrorModel, ResponseBound, response_bounds
from plant_sim.can_bus.traffic.inference import InferredBus, InferredMessage
from plant_sim.can_bus.traffic.messages import BusMessage

_SAME_PERIOD = 0.05
"""Greatest relative difference in period between a recorded message and the same added one."""


@dataclass(frozen=True, slots=True)
class Effect:
    """Response bounds of one message without (``before``) and with the added ones (``after``).

    ``seen``: its evidence in the log; None, like ``before``, for an added message. ``assumes``:
    names of event-driven messages on whose recorded density the bounds depend.
    """

    message: BusMessage
    seen: InferredMessage | None
    before: ResponseBound | None
    after: ResponseBound
    assumes: tuple[str, ...]


def missing_from(bus: InferredBus, messages: Sequence[BusMessage]) -> list[BusMessage]:
    """Return those of ``messages`` that are not already on the recorded bus.

    A message is on it if the log has a periodic message with its identifier, length and period. In
    a log with most of ``messages``, which is one of their own, so is one of the same length that is
    sent no more often: on events, or by its heartbeat alone. Any other message with its identifier
    collides with it.
    """
    known = {m.message.arbitration_key: m for m in bus.messages}
    missing = [m for m in messages if not _same(known.get(m.arbitration_key), m)]
    if 2 * len(missing) >= len(messages):
        return missing
    return [m for m in missing if not _no_more_often(known.get(m.arbitration_key), m, bus.span_ns)]


def _same(found: InferredMessage | None, message: BusMessage) -> bool:
    if found is None or found.message.length != message.length:
        return False
    off = abs(found.arrivals.cycle - message.period_ns)
    return off <= _SAME_PERIOD * message.period_ns


def _no_more_often(found: InferredMessage | None, message: BusMessage, span_ns: int) -> bool:
    if found is None or found.message.length != message.length:
        return False
    return found.arrivals.frames * message.period_ns <= (1 + _SAME_PERIOD) * span_ns


def joined(bus: InferredBus, messages: Sequence[BusMessage]) -> list[BusMessage]:
    """Return all messages on the bus with ``messages``, which replace the same recorded ones."""
    more = {m.name for m in missing_from(bus, messages)}
    there = {m.arbitration_key for m in messages if m.name not in more}
    recorded = [m.message for m in bus.messages]
    return [*(m for m in recorded if m.arbitration_key not in there), *messages]


def effects(
    bus: InferredBus, added: Sequence[BusMessage], *, errors: ErrorModel | None = None
) -> list[Effect]:
    """Return the effect of ``added`` messages on all response times, in order of arbitration.

    A bound exceeded in the log itself is dropped: the inferred arrival curve is then wrong.
    """
    recorded = [m.message for m in bus.messages]
    before, after = (
        response_bounds(
            messages, bitrate=bus.rate.nominal, data_bitrate=bus.rate.data, errors=errors
        )
        for messages in (recorded, [*recorded, *added])
    )
    found: list[Effect] = []
    for place, bound in enumerate(after):
        seen = bus.messages[place] if place < len(recorded) else None
        first = before[place] if seen else None
        assumes = tuple(
            m.message.name
            for m in bus.messages
            if m.assumed and m.message.arbitration_key <= bound.message.arbitration_key
        )
        found.append(
            Effect(
                bound.message,
                seen,
                None if first is None else _checked(first, seen),
                _checked(bound, seen),
                assumes,
            )
        )
    return sorted(found, key=lambda effect: effect.message.arbitration_key)


def _checked(bound: ResponseBound, seen: InferredMessage | None) -> ResponseBound:
    if seen is None or bound.bound_ns is None or seen.seen_ns <= bound.bound_ns:
        return bound
    reason = f"{seen.seen_ns * 1e-6:.3f} ms in the log itself: its jitter is not what was inferred"
    return replace(bound, bound_ns=None, queued_ns=None, reason=reason, covered=False)
