"""Proposals for a set of messages: priorities that meet all deadlines, and offsets."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import lcm
from typing import Final

from canroll.errors import VerdictError
from plant_sim.can_bus.bounds.analysis import ResponseBound
from plant_sim.can_bus.bounds.sensitivity import Bounds, late
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import EXTENDED
from plant_sim.kernels.instants import MS

_GRAIN_NS: Final = MS // 2
"""Offsets are multiples of this, ns."""
_HORIZON: Final = 2000
"""Greatest number of such slots over which the offsets of one node are spread."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A changed set and its bounds, in the order of the original set."""

    messages: tuple[BusMessage, ...]
    bounds: tuple[ResponseBound, ...]


def propose_priorities(messages: Sequence[BusMessage], bounds: Bounds) -> Proposal:
    """Return the set with its identifiers reassigned so that every deadline is met.

    Audsley, "Optimal priority assignment and feasibility of static priority tasks with arbitrary
    start times" (1991), optimal for CAN (Davis et al. 2007, section 6) where no queue is first in,
    first out: from the lowest upwards, each priority is given to a message that meets its deadline
    with it, preferably its present owner. Identifiers of 11 and of 29 bits are not exchanged.

    Raises:
        VerdictError: no assignment of these identifiers meets all deadlines.
    """
    order = sorted(messages, key=lambda m: m.arbitration_key)
    for place in range(len(order) - 1, -1, -1):
        kind = order[place].flags & EXTENDED
        for other in range(place, -1, -1):
            if order[other].flags & EXTENDED != kind:
                continue
            trial = [m.ident for m in order]
            trial[place], trial[other] = trial[other], trial[place]
            swapped = [replace(m, ident=i) for m, i in zip(order, trial, strict=True)]
            answers = bounds(swapped, None)
            if not late([answers[other]]):
                order = sorted(swapped, key=lambda m: m.arbitration_key)
                break
        else:
            ident = order[place].ident
            raise VerdictError(
                f"no priorities meet all deadlines: no message left for 0x{ident:X} meets its own"
            )
    named = {m.name: m for m in order}
    changed = tuple(named[m.name] for m in messages)
    answers = bounds(changed, None)
    if late(answers):
        names = ", ".join(late(answers))
        raise VerdictError(f"no priorities found that meet all deadlines: {names} in FIFO queues")
    return Proposal(changed, tuple(answers))


def propose_offsets(messages: Sequence[BusMessage], bounds: Bounds) -> Proposal:
    """Return the set with the messages of each node spread over time.

    One by one, the most frequent first, each is given the offset with the fewest releases of the
    node, and among these the one farthest from other releases (after Grenier, Havet, Navet,
    "Pushing the limits of CAN: scheduling frames with offsets", ERTS 2008).
    """
    offsets = {}
    for node in dict.fromkeys(m.sender for m in messages):
        own = sorted((m for m in messages if m.sender == node), key=lambda m: m.period_ns)
        periods = [max(int(m.period_ns // _GRAIN_NS), 1) for m in own]
        busy = [0] * min(lcm(*periods), _HORIZON)
        for message, period in zip(own, periods, strict=True):
            start = _quietest(busy, period)
            offsets[message.name] = start * _GRAIN_NS
            for slot in range(start, len(busy), period):
                busy[slot] += 1
    changed = tuple(replace(m, offset_ns=offsets[m.name]) for m in messages)
    return Proposal(changed, tuple(bounds(changed, None)))


def _quietest(busy: Sequence[int], period: int) -> int:
    """Return the first slot of the period with the fewest releases, farthest from others."""
    starts = range(min(period, len(busy)))
    met = [max(busy[slot] for slot in range(start, len(busy), period)) for start in starts]
    quiet = [start for start in starts if met[start] == min(met)]
    taken = [start for start in starts if met[start] > min(met)]

    def room(start: int) -> int:
        gaps = (abs(start - other) for other in taken)
        return min((min(gap, len(starts) - gap) for gap in gaps), default=0)

    return max(quiet, key=lambda start: (room(start), -start))
