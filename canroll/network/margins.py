"""Margins of a traffic set: on its rates and against errors; and proposals for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from canroll.errors import VerdictError
from plant_sim.can_bus.bounds.analysis import ErrorModel, ResponseBound, response_bounds
from plant_sim.can_bus.bounds.proposals import propose_offsets, propose_priorities
from plant_sim.can_bus.bounds.sensitivity import (
    Bounds,
    Breakdown,
    ErrorTolerance,
    breakdown,
    error_tolerance,
)
from plant_sim.can_bus.traffic.files import Traffic
from plant_sim.can_bus.traffic.messages import BusMessage


@dataclass(frozen=True, slots=True)
class BusMargins:
    """Requested results besides the bounds, None where not requested.

    ``tolerance``: at ``errors_per_s``. Of a proposal ``kind``, the bounds ``before`` and ``after``
    in the order of the set, and why there is none (``refused``).
    """

    breakdown: Breakdown | None = None
    errors_per_s: float | None = None
    tolerance: Sequence[ErrorTolerance] = ()
    kind: str | None = None
    before: Sequence[ResponseBound] = ()
    after: Sequence[ResponseBound] = ()
    refused: str = ""

    @property
    def proposed(self) -> list[tuple[ResponseBound, ResponseBound]]:
        """Every message's bound before and with the proposal."""
        return list(zip(self.before, self.after, strict=True))


@dataclass(frozen=True, slots=True)
class MarginsRequest:
    """What is computed for a traffic set alone.

    ``offsets``: the messages of one node keep their offsets in the bounds. ``sensitivity``: the
    breakdown. ``errors_per_s``: rate of random errors for the tolerance. ``propose``: "priorities"
    or "offsets".
    """

    offsets: bool
    sensitivity: bool
    errors_per_s: float | None
    propose: str | None


def margins_of(traffic: Traffic, request: MarginsRequest) -> BusMargins:
    """Return the requested margins of a set."""
    rates: dict[str, Any] = {"bitrate": traffic.bitrate, "data_bitrate": traffic.data_bitrate}
    messages = traffic.messages

    def bounded(kept: bool) -> Bounds:
        def of(chosen: Sequence[BusMessage], errors: ErrorModel | None) -> list[ResponseBound]:
            return response_bounds(chosen, errors=errors, offsets=kept, **rates)

        return of

    bounds = bounded(request.offsets)
    propose, errors_per_s = request.propose, request.errors_per_s
    before: Sequence[ResponseBound] = ()
    after: Sequence[ResponseBound] = ()
    refused = ""
    try:
        if propose == "priorities":
            after = propose_priorities(messages, bounds).bounds
        elif propose == "offsets":
            after = propose_offsets(messages, bounded(kept=True)).bounds
    except VerdictError as error:
        refused = str(error)
    if after:
        before = bounds(messages, None)
    return BusMargins(
        breakdown(messages, bounds, **rates) if request.sensitivity else None,
        errors_per_s,
        ()
        if errors_per_s is None
        else error_tolerance(messages, bounds, errors_per_s=errors_per_s),
        propose,
        before,
        after,
        refused,
    )
