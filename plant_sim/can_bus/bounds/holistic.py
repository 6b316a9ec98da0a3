"""Response times over several segments joined by gateways.

Holistic analysis (Tindell, Clark, "Holistic schedulability analysis for distributed hard real-time
systems", 1994): the variation of a message's response on one segment and of the gateway's latency
is its jitter on the next; all segments are analysed repeatedly until no jitter changes. Jitter only
grows from round to round, so the first fixed point is the least one. Offsets are not used behind a
gateway. Bounds with an error model do not include duplicates that a gateway forwards after an
inconsistent error.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from canroll.plant_sim.buses.topology import Topology
from canroll.plant_sim.can_bus.bounds.analysis import (
    OVERLOADED,
    ErrorModel,
    ResponseBound,
    response_bounds,
)
from canroll.plant_sim.can_bus.network.routing import Hop, RoutedMessage, RoutedNetwork
from canroll.plant_sim.can_bus.traffic.messages import BusMessage

_MOST_WAITING_NS: Final = 10**9
"""Jitter that grows by more than this through waiting is treated as unlimited, ns: FIFO queues on
several segments can increase each other's jitter without end."""
UNLIMITED: Final = "a gateway passes on a message of at least this priority without a bound"


@dataclass(frozen=True, slots=True)
class HolisticArrival:
    """Bounds of a message's arrival on a segment, in ns from its nominal release by the sender.

    ``least_ns``: earliest reception. ``greatest_ns``: latest end of the interframe space, None if
    there is no bound. ``here``: the response on this segment alone, from its nominal release there.
    """

    least_ns: int
    greatest_ns: int | None
    here: ResponseBound


def arrivals(
    network: RoutedNetwork,
    *,
    errors: ErrorModel | None = None,
    offsets: bool = False,
) -> list[dict[int, HolisticArrival]]:
    """Return the bounds of every message's arrival on each of its segments, by segment number.

    Args:
        network: with all messages on it.
        errors: disturbed frames on each segment included in the bounds.
        offsets: whether the messages of one node keep their offsets; not used on a segment to which
            a gateway forwards.
    """
    topology, routed = network.topology, network.messages
    spans: dict[tuple[int, int], int | None] = {}
    limit = _MOST_WAITING_NS + sum(r.message.jitter_ns for r in routed)
    limit += sum(gateway.latency.high_ns for gateway in topology.gateways)
    while True:
        bounds = [
            _on_segment(network, segment, spans, errors=errors, offsets=offsets)
            for segment in range(len(topology.segments))
        ]
        update: dict[tuple[int, int], int | None] = {}
        for number, r in enumerate(routed):
            for hop in r.hops:
                span = _span(topology, hop, bounds[hop.source][number])
                endless = span is None or span > limit or spans.get((number, hop.target), 0) is None
                update[number, hop.target] = None if endless else span
        if update == spans:
            return [_arrivals(topology, n, r, bounds) for n, r in enumerate(routed)]
        spans = update


def _on_segment(
    network: RoutedNetwork,
    segment: int,
    spans: dict[tuple[int, int], int | None],
    *,
    errors: ErrorModel | None,
    offsets: bool,
) -> dict[int, ResponseBound]:
    """Bounds of all messages on one segment by number, with the jitter ``spans`` on arrival."""
    topology, routed = network.topology, network.messages
    numbers = [n for n, r in enumerate(routed) if segment in r.segments]
    here = [_as_it_comes(network, routed[n], segment, spans.get((n, segment))) for n in numbers]
    unlimited = [i for i, n in enumerate(numbers) if spans.get((n, segment), 0) is None]
    place = topology.segments[segment]
    bounds = response_bounds(
        here,
        bitrate=place.bitrate,
        data_bitrate=place.data_bitrate,
        errors=errors,
        offsets=offsets and all(routed[n].home == segment for n in numbers),
        unlimited=unlimited,
    )
    return {
        n: replace(b, reason=UNLIMITED) if unlimited and b.reason == OVERLOADED else b
        for n, b in zip(numbers, bounds, strict=True)
    }


def _as_it_comes(
    network: RoutedNetwork, routed: RoutedMessage, segment: int, span: int | None
) -> BusMessage:
    """A message on one of its segments, as sent or as forwarded by a gateway."""
    if segment == routed.home:
        return routed.message
    hop = routed.way_to(segment)[-1]
    gateway = network.topology.gateways[hop.gateway]
    least = gateway.latency.high_ns - gateway.latency.low_ns
    return replace(
        routed.message,
        sender=network.sender_on(routed, segment),
        jitter_ns=least if span is None else span,
        fifo=False,
        distance_ns=0,
    )


def _span(topology: Topology, hop: Hop, before: ResponseBound) -> int | None:
    """Variation of a message's release behind a gateway, ns; None: unlimited."""
    if before.bound_ns is None:
        return None
    latency = topology.gateways[hop.gateway].latency
    # where a bit is no whole number of ns, both instants of reception are rounded
    rounding = 2 * (10**9 % topology.segments[hop.source].bitrate != 0)
    return before.bound_ns - before.best_ns + rounding + latency.high_ns - latency.low_ns


def _arrivals(
    topology: Topology,
    number: int,
    routed: RoutedMessage,
    bounds: Sequence[dict[int, ResponseBound]],
) -> dict[int, HolisticArrival]:
    answer: dict[int, HolisticArrival] = {}
    for segment in routed.segments:
        nominal, least = 0, topology.least_jitter_ns(routed.message.sender)
        for hop in routed.way_to(segment):
            low = topology.gateways[hop.gateway].latency.low_ns
            nominal += bounds[hop.source][number].best_ns + low
            least += _delivery(topology, routed, hop.source) + low
        here = bounds[segment][number]
        greatest = None if here.bound_ns is None else nominal + here.bound_ns
        answer[segment] = HolisticArrival(
            least + _delivery(topology, routed, segment), greatest, here
        )
    return answer


def _delivery(topology: Topology, routed: RoutedMessage, segment: int) -> int:
    place = topology.segments[segment]
    return routed.message.least_delivery_ns(place.bitrate, place.data_bitrate)
