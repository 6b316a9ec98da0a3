"""Response times on a recorded bus, before and after more messages come onto it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from plant_sim.can_bus.analysis import ErrorModel, ResponseBound, response_bounds
from plant_sim.can_bus.traffic.inference import InferredBus, InferredMessage
from plant_sim.can_bus.traffic.messages import BusMessage

_SAME_PERIOD = 0.05
"""A recorded message is the added one if its period differs by no more than this share."""


@dataclass(frozen=True, slots=True)
class Effect:
    """Response bounds of one message without and with those added; None: it is not there.

    ``seen``: what the log says of it, None of an added message. ``assumes``: names of recorded
    messages that nothing limits and on whose recorded density the bounds rest.
    """

    message: BusMessage
    seen: InferredMessage | None
    before: ResponseBound | None
    after: ResponseBound
    assumes: tuple[str, ...]


def missing_from(bus: InferredBus, messages: Sequence[BusMessage]) -> list[BusMessage]:
    """Return those of ``messages`` that are not on the recorded bus already.

    One is if a periodic identifier of the log has its identifier, length and period. Another one
    of the same identifier collides with it.
    """
    known = {m.message.arbitration_key: m for m in bus.messages}
    return [m for m in messages if not _same(known.get(m.arbitration_key), m)]


def _same(found: InferredMessage | None, message: BusMessage) -> bool:
    if found is None or found.message.length != message.length:
        return False
    off = abs(found.arrivals.cycle - message.period_ns)
    return off <= _SAME_PERIOD * message.period_ns


def joined(bus: InferredBus, messages: Sequence[BusMessage]) -> list[BusMessage]:
    """Return what is on the bus with ``messages``, which stand for the recorded ones they are."""
    more = {m.name for m in missing_from(bus, messages)}
    there = {m.arbitration_key for m in messages if m.name not in more}
    recorded = [m.message for m in bus.messages]
    return [*(m for m in recorded if m.arbitration_key not in there), *messages]


def effects(
    bus: InferredBus, added: Sequence[BusMessage], *, errors: ErrorModel | None = None
) -> list[Effect]:
    """Return what ``added`` messages do to the response times of all, in order of arbitration.

    A bound that the log itself exceeds is none: then its curve does not hold.
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
