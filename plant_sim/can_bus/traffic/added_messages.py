"""Messages added to a recorded bus: which of them it has already."""

from collections.abc import Sequence

from canroll.plant_sim.can_bus.traffic.inference import InferredBus, InferredMessage
from canroll.plant_sim.can_bus.traffic.messages import BusMessage

_SAME_PERIOD = 0.05
"""Greatest relative difference in period between a recorded message and the same added one."""


def missing_from(bus: InferredBus, messages: Sequence[BusMessage]) -> list[BusMessage]:
    """Return those of ``messages`` that are not already on the recorded bus.

    A message is on it if the log has a periodic message with its identifier, length and period. In
    a log with most of ``messages``, which is one of them, so is one of the same length that is
    sent no more often: on events, or by its heartbeat alone. Any other message with its identifier
    collides with it.
    """
    known = {m.message.arbitration_key: m for m in bus.messages}
    missing = [m for m in messages if not _same(known.get(m.arbitration_key), m)]
    if 2 * len(missing) >= len(messages):
        return missing
    return [m for m in missing if not _no_more_often(known.get(m.arbitration_key), m, bus.span_ns)]


def _same(inferred: InferredMessage | None, message: BusMessage) -> bool:
    if inferred is None or inferred.assumed or inferred.message.length != message.length:
        return False
    off = abs(inferred.message.period_ns - message.period_ns)
    return off <= _SAME_PERIOD * message.period_ns


def _no_more_often(inferred: InferredMessage | None, message: BusMessage, span_ns: int) -> bool:
    if inferred is None or inferred.message.length != message.length:
        return False
    return inferred.frames * message.period_ns <= (1 + _SAME_PERIOD) * span_ns


def joined(bus: InferredBus, messages: Sequence[BusMessage]) -> list[BusMessage]:
    """Return all messages on the bus with ``messages``, which replace the same recorded ones."""
    more = {m.name for m in missing_from(bus, messages)}
    there = {m.arbitration_key for m in messages if m.name not in more}
    recorded = [m.message for m in bus.messages]
    return [*(m for m in recorded if m.arbitration_key not in there), *messages]
