"""Proposals for a set of messages: priorities with which all deadlines hold, and offsets."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from canroll.errors import VerdictError
from plant_sim.can_bus.analysis import ResponseBound
from plant_sim.can_bus.sensitivity import Bounds, late
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import EXTENDED

MS: Final = 1_000_000
_GRAIN_NS: Final = MS // 2
"""Offsets are multiples of this."""
_HORIZON: Final = 2000
"""Slots of that grain that the offsets of one node are spread over, at most."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A set as it could be, and its bounds; in the order of the set as it is."""

    messages: tuple[BusMessage, ...]
    bounds: tuple[ResponseBound, ...]


def propose_priorities(messages: Sequence[BusMessage], bounds: Bounds) -> Proposal:
    """Return the set with its own identifiers dealt out so that every deadline holds.

    Audsley, "Optimal priority assignment and feasibility of static priority tasks with arbitrary
    start times" (1991), optimal for CAN (Davis et al. 2007, section 6): from the lowest priority
    upwards each goes to a message that keeps its deadline there, the one that has it already if it
    can. Messages with 11 and with 29 bits change places among themselves.

    Raises:
        VerdictError: no assignment of these identifiers keeps all deadlines.
    """
    current = sorted(messages, key=lambda m: m.arbitration_key)
    idents = [(m.ident, m.flags & EXTENDED) for m in current]
    left = list(current)
    dealt: dict[str, int] = {}
    for place in range(len(idents) - 1, -1, -1):
        ident, kind = idents[place]
        for message in reversed(left):
            if message.flags & EXTENDED == kind and _keeps(
                message, ident, left, idents[: place + 1], dealt, messages, bounds
            ):
                dealt[message.name] = ident
                left.remove(message)
                break
        else:
            names = ", ".join(m.name for m in left if m.flags & EXTENDED == kind)
            raise VerdictError(
                f"no priorities keep all deadlines: none of {names} keeps its own at {ident:X}"
            )
    changed = tuple(replace(m, ident=dealt[m.name]) for m in messages)
    return Proposal(changed, tuple(bounds(changed, None)))


def _keeps(
    message: BusMessage,
    ident: int,
    left: Sequence[BusMessage],
    idents: Sequence[tuple[int, int]],
    dealt: dict[str, int],
    messages: Sequence[BusMessage],
    bounds: Bounds,
) -> bool:
    """Return whether a message keeps its deadline with an identifier, whatever the others have."""
    rest = {
        kind: iter(
            [i for i, k in idents if k == kind and (i, k) != (ident, message.flags & EXTENDED)]
        )
        for kind in (0, EXTENDED)
    }
    trial = dict(dealt)
    trial[message.name] = ident
    for other in left:
        if other is not message:
            trial[other.name] = next(rest[other.flags & EXTENDED])
    found = bounds([replace(m, ident=trial[m.name]) for m in messages], None)
    return not late([b for b in found if b.message.name == message.name])


def propose_offsets(messages: Sequence[BusMessage], bounds: Bounds) -> Proposal:
    """Return the set with the messages of each node spread over time.

    One by one, the most frequent first, each gets the offset at which the node is busy least, and
    among these the one farthest from the busy ones (after Grenier, Havet, Navet, "Pushing the
    limits of CAN: scheduling frames with offsets", ERTS 2008).
    """
    offsets = {}
    for node in dict.fromkeys(m.sender for m in messages):
        own = sorted((m for m in messages if m.sender == node), key=lambda m: m.period_ns)
        slots = min(int(max(m.period_ns for m in own) // _GRAIN_NS), _HORIZON)
        busy = [0] * max(slots, 1)
        for message in own:
            period = max(int(message.period_ns // _GRAIN_NS), 1)
            start = _quietest(busy, period)
            offsets[message.name] = start * _GRAIN_NS
            for slot in range(start, len(busy), period):
                busy[slot] += 1
    changed = tuple(replace(m, offset_ns=offsets[m.name]) for m in messages)
    return Proposal(changed, tuple(bounds(changed, None)))


def _quietest(busy: Sequence[int], period: int) -> int:
    """Return the start of a comb of that period that meets the least, farthest from all."""
    starts = range(min(period, len(busy)))
    met = [max(busy[slot] for slot in range(start, len(busy), period)) for start in starts]
    quiet = [start for start in starts if met[start] == min(met)]
    taken = [start for start in starts if met[start] > min(met)]

    def room(start: int) -> int:
        gaps = (abs(start - other) for other in taken)
        return min((min(gap, len(starts) - gap) for gap in gaps), default=0)

    return max(quiet, key=lambda start: (room(start), -start))
