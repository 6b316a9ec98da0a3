"""The kernel's description of a network: nodes, periodic sources, and gateways one way each."""

from collections.abc import Sequence

from canroll.plant_sim.can_bus.kernel.network import (
    MAX_CAPACITY,
    Gateway,
    NetworkSpec,
    Node,
    Segment,
)
from canroll.plant_sim.can_bus.network.routing import Hop, RoutedMessage, RoutedNetwork


def network_spec(
    network: RoutedNetwork,
    *,
    nodes: Sequence[Node] = (),
    sources: Sequence[RoutedMessage] | None = None,
    seed: int = 0,
) -> NetworkSpec:
    """Return the description of a network with its messages.

    The nodes are ``nodes``, then the other senders of ``sources``, then each gateway's on either
    segment. A sender with a FIFO message queues all of its messages first in, first out.

    Args:
        network: with all messages that gateways may pass on.
        nodes: those with a number or a queue that matters.
        sources: those of its messages that the network itself sends; None: all.
        seed: of payloads, jitter, latencies and bit errors.
    """
    topology, routed = network.topology, network.messages
    sent = routed if sources is None else sources
    known = {node.name for node in nodes}
    queued = {r.message.sender for r in sent if r.message.fifo}
    homes = {r.message.sender: r.home for r in sent}
    every = list(nodes)
    every += [
        Node(name, home, "fifo" if name in queued else "priority", capacity=MAX_CAPACITY)
        for name, home in homes.items()
        if name not in known
    ]
    gateways = []
    for number, gateway in enumerate(topology.gateways):
        ports = {segment: network.port(number, segment) for segment in gateway.segments}
        every += [Node(port, segment, "priority") for segment, port in ports.items()]
        for source, target in (gateway.segments, gateway.segments[::-1]):
            hop = Hop(number, source, target)
            passed = tuple((r.message.ident, r.message.flags) for r in routed if hop in r.hops)
            gateways.append(Gateway(ports[source], ports[target], gateway.latency, passed))
    return NetworkSpec(
        segments=tuple(
            Segment(place.bitrate, place.data_bitrate, bit_error_rate=place.bit_error_rate)
            for place in topology.segments
        ),
        nodes=tuple(every),
        sources=tuple(r.message.source() for r in sent),
        gateways=tuple(gateways),
        seed=seed,
    )
