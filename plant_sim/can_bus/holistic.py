"""Response times over several segments that gateways join.

Holistic analysis (Tindell, Clark, "Holistic schedulability analysis for distributed hard real-time
systems", 1994): what a message's response on one segment varies by, and the latency of the gateway,
is its jitter on the next; the segments are analysed in turn until nothing changes. Jitter only
grows from round to round, so that the first fixed point is the least.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from plant_sim.buses.topology import Topology
from plant_sim.can_bus.analysis import ErrorModel, ResponseBound, response_bounds
from plant_sim.can_bus.routing import Hop, RoutedMessage
from plant_sim.can_bus.traffic.messages import BusMessage

_MAX_ROUNDS: Final = 50


@dataclass(frozen=True, slots=True)
class Arrival:
    """When a message's frames arrive on a segment, ns from their nominal release by the sender.

    ``least_ns``: reception at the earliest. ``greatest_ns``: end of the interframe space at the
    latest, None: without bound. ``here``: the response on this segment alone, from the nominal
    instant at which it comes here.
    """

    least_ns: int
    greatest_ns: int | None
    here: ResponseBound


def arrivals(
    topology: Topology, routed: Sequence[RoutedMessage], *, errors: ErrorModel | None = None
) -> list[dict[int, Arrival]]:
    """Return, for every message of a network, when it arrives on each of its segments, by number.

    Args:
        topology: the network.
        routed: all messages on it, as of :func:`plant_sim.can_bus.profiles.routed_messages`.
        errors: disturbed frames that the bounds of every segment allow for.
    """
    spans: dict[tuple[int, int], int | None] = {}
    for _ in range(_MAX_ROUNDS):
        bounds = [
            _on_segment(topology, routed, segment, spans, errors)
            for segment in range(len(topology.segments))
        ]
        update = {
            (number, hop.target): _span(topology, hop, bounds[hop.source][number])
            for number, found in enumerate(routed)
            for hop in found.hops
        }
        if update == spans:
            break
        spans = update
    else:
        bounds = [
            {n: replace(b, bound_ns=None, queued_ns=None) for n, b in here.items()}
            for here in bounds
        ]
    return [_arrivals(topology, number, found, bounds) for number, found in enumerate(routed)]


def _on_segment(
    topology: Topology,
    routed: Sequence[RoutedMessage],
    segment: int,
    spans: dict[tuple[int, int], int | None],
    errors: ErrorModel | None,
) -> dict[int, ResponseBound]:
    """The bounds of all messages on one segment by number, if they come to it within ``spans``."""
    numbers = [n for n, found in enumerate(routed) if segment in found.segments]
    here = [_as_it_comes(topology, routed[n], segment, spans.get((n, segment))) for n in numbers]
    unlimited = [
        m.arbitration_key
        for n, m in zip(numbers, here, strict=True)
        if spans.get((n, segment), 0) is None
    ]
    place = topology.segments[segment]
    bounds = response_bounds(
        here, bitrate=place.bitrate, data_bitrate=place.data_bitrate, errors=errors
    )
    most = min(unlimited, default=1 << 62)
    return {
        n: replace(b, bound_ns=None, queued_ns=None) if b.message.arbitration_key >= most else b
        for n, b in zip(numbers, bounds, strict=True)
    }


def _as_it_comes(
    topology: Topology, found: RoutedMessage, segment: int, span: int | None
) -> BusMessage:
    """A message on one of its segments: as sent, or as a gateway sends it on."""
    if segment == found.home:
        return found.message
    hop = found.way_to(segment)[-1]
    gateway = topology.gateways[hop.gateway]
    least = gateway.latency.high_ns - gateway.latency.low_ns
    return replace(
        found.message,
        sender=f"{gateway.name}@{topology.segments[segment].name}",
        jitter_ns=least if span is None else span,
        fifo=False,
        distance_ns=0,
    )


def _span(topology: Topology, hop: Hop, before: ResponseBound) -> int | None:
    """How far apart the times can be at which a message comes over a gateway."""
    if before.bound_ns is None:
        return None
    latency = topology.gateways[hop.gateway].latency
    return before.bound_ns - before.best_ns + latency.high_ns - latency.low_ns


def _arrivals(
    topology: Topology,
    number: int,
    found: RoutedMessage,
    bounds: Sequence[dict[int, ResponseBound]],
) -> dict[int, Arrival]:
    answer: dict[int, Arrival] = {}
    for segment in found.segments:
        nominal, least = 0, topology.least_jitter_ns(found.message.sender)
        for hop in found.way_to(segment):
            low = topology.gateways[hop.gateway].latency.low_ns
            nominal += bounds[hop.source][number].best_ns + low
            least += _delivery(topology, found, hop.source) + low
        here = bounds[segment][number]
        greatest = None if here.bound_ns is None else nominal + here.bound_ns
        answer[segment] = Arrival(least + _delivery(topology, found, segment), greatest, here)
    return answer


def _delivery(topology: Topology, found: RoutedMessage, segment: int) -> int:
    place = topology.segments[segment]
    return found.message.least_delivery_ns(place.bitrate, place.data_bitrate)
