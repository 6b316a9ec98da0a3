"""Response times on a recorded bus, without and with additional messages."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from canroll.plant_sim.can_bus.bounds.analysis import ErrorModel, ResponseBound, response_bounds
from canroll.plant_sim.can_bus.traffic.inference import InferredBus, InferredMessage
from canroll.plant_sim.can_bus.traffic.messages import BusMessage


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


def effects(
    bus: InferredBus, added: Sequence[BusMessage], *, errors: ErrorModel | None = None
) -> list[Effect]:
    """Return the effect of ``added`` messages on all response times, in order of arbitration.

    A bound exceeded in the log itself is dropped: the inferred arrival curve is then wrong.
    """
    recorded = [m.message for m in bus.messages]
    before, after = (
        response_bounds(messages, bitrate=bus.bitrate, data_bitrate=bus.data_bitrate, errors=errors)
        for messages in (recorded, [*recorded, *added])
    )
    rows: list[Effect] = []
    for place, bound in enumerate(after):
        seen = bus.messages[place] if place < len(recorded) else None
        first = before[place] if seen else None
        assumes = tuple(
            m.message.name
            for m in bus.messages
            if m.assumed and m.message.arbitration_key <= bound.message.arbitration_key
        )
        rows.append(
            Effect(
                bound.message,
                seen,
                None if first is None else _checked(first, seen),
                _checked(bound, seen),
                assumes,
            )
        )
    return sorted(rows, key=lambda effect: effect.message.arbitration_key)


def _checked(bound: ResponseBound, seen: InferredMessage | None) -> ResponseBound:
    if seen is None or bound.bound_ns is None or seen.seen_ns <= bound.bound_ns:
        return bound
    reason = f"{seen.seen_ns * 1e-6:.3f} ms in the log itself: its jitter is not what was inferred"
    return replace(bound, bound_ns=None, queued_ns=None, reason=reason, covered=False)
