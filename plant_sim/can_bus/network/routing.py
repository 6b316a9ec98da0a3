"""Which way each message goes over the segments and gateways of a network."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.buses.topology import NODES, BusGateway, BusSegment, Topology
from canroll.plant_sim.can_bus.traffic.messages import BusMessage


class Hop(NamedTuple):
    """A gateway, by its number, that passes a message on from segment ``source`` to ``target``."""

    gateway: int
    source: int
    target: int


@dataclass(frozen=True, slots=True)
class RoutedMessage:
    """A message, the segment it is sent on, and its hops in the order in which a frame takes them.

    The hops are a tree: no segment gets a message twice.
    """

    message: BusMessage
    home: int
    hops: tuple[Hop, ...] = ()

    @property
    def segments(self) -> tuple[int, ...]:
        """Every segment that it is on, its own first."""
        return (self.home, *(hop.target for hop in self.hops))

    def way_to(self, segment: int) -> tuple[Hop, ...]:
        """Return the hops from its own segment to ``segment``, on which it is, in order."""
        way: list[Hop] = []
        while segment != self.home:
            hop = next(hop for hop in self.hops if hop.target == segment)
            way.insert(0, hop)
            segment = hop.source
        return tuple(way)


@dataclass(frozen=True, slots=True)
class RoutedNetwork:
    """A network and all messages on it: ours, then the background."""

    topology: Topology
    messages: Sequence[RoutedMessage]

    @classmethod
    def one_bus(
        cls, messages: Iterable[BusMessage], *, bitrate: int, data_bitrate: int = 0
    ) -> "RoutedNetwork":
        """Return a set of messages as a network of one segment."""
        segment = BusSegment("bus", bitrate, data_bitrate=data_bitrate)
        return cls(Topology((segment,)), [RoutedMessage(message, 0) for message in messages])

    def sender_on(self, routed: RoutedMessage, segment: int) -> str:
        """Return the node that sends a message on a segment: its sender, or a gateway's node."""
        if segment == routed.home:
            return routed.message.sender
        return self.port(routed.way_to(segment)[-1].gateway, segment)

    def port(self, gateway: int, segment: int) -> str:
        """Return the name of a gateway's node on a segment."""
        return f"{self.topology.gateways[gateway].name}@{self.topology.segments[segment].name}"

    def pair(self, sensor: str, command: str) -> tuple[RoutedMessage, RoutedMessage]:
        """Return the two messages of a control loop; of several with a name, the first.

        Raises:
            CanrollError: there are no two such messages.
        """
        named = {r.message.name: r for r in reversed(self.messages)}
        for name in (sensor, command):
            if name not in named:
                raise UnknownNameError("message of the set", name, named)
        if sensor == command:
            raise CanrollError(f"message '{sensor}' cannot be both sensor and command")
        return named[sensor], named[command]

    def in_every_tick(self, command: str, *, tick_ms: float) -> "RoutedNetwork":
        """Return the network with the period of ``command``, the first of that name, the tick."""
        changed = list(self.messages)
        for place, r in enumerate(changed):
            if r.message.name == command:
                message = replace(r.message, period_ns=float(round(tick_ms * 1e6)))
                changed[place] = replace(r, message=message)
                break
        return replace(self, messages=changed)


def route(
    topology: Topology,
    own: Sequence[BusMessage],
    background: Sequence[Sequence[BusMessage]],
    aliases: Mapping[str, str],
    *,
    known: Sequence[BusMessage] = (),
) -> tuple[RoutedMessage, ...]:
    """Return the ways of all messages: ours in their order, then those of each segment.

    A gateway with a list of messages passes on what is in it, whichever side it comes from; one
    without passes on those of ours that have a receiver behind it, by the way of least gateways.

    Args:
        topology: the network.
        own: our messages, with the names of the contract.
        background: the other messages of each segment.
        aliases: what our messages are called on this bus, by the contract's name.
        known: further messages of ours, such as commands that are not in use.

    Raises:
        CanrollError: no gateway passes on a message that a receiver needs; a message would come
            back to a segment that it has been on; an identifier is on a segment twice.
        UnknownNameError: a gateway lists an unknown message.
    """
    others = [(segment, m) for segment, messages in enumerate(background) for m in messages]
    messages = [*known, *own, *(m for _, m in others)]
    listed = [_listed(gateway, messages, aliases) for gateway in topology.gateways]
    routed = [_own_way(topology, message, listed) for message in own]
    for home, message in others:
        passes = [keys is not None and _key(message) in keys for keys in listed]
        routed.append(_flooded(topology, message, home, passes))
    _check_identifiers(topology, routed, len(own))
    return tuple(routed)


_Key = tuple[int, str]
"""Identity of a message that gateways may list: arbitration key and name."""


def _key(message: BusMessage) -> _Key:
    return message.arbitration_key, message.name


def _listed(
    gateway: BusGateway, messages: Sequence[BusMessage], aliases: Mapping[str, str]
) -> frozenset[_Key] | None:
    """What a gateway lists; None: it lists nothing."""
    if gateway.messages is None:
        return None
    keys: set[_Key] = set()
    for entry in gateway.messages:
        meant = {
            _key(m)
            for m in messages
            if entry in ((m.name, aliases.get(m.name)) if isinstance(entry, str) else (m.ident,))
        }
        if not meant:
            names = [name for m in messages for name in (m.name, aliases.get(m.name)) if name]
            what = f"message of gateway '{gateway.name}'"
            if isinstance(entry, str):
                raise UnknownNameError(what, entry, sorted(set(names)))
            raise CanrollError(f"{what}: no message of the network has identifier 0x{entry:X}")
        keys |= meant
    return frozenset(keys)


def _own_way(
    topology: Topology, message: BusMessage, listed: Sequence[frozenset[_Key] | None]
) -> RoutedMessage:
    """The way of one of our messages, to every receiver of it."""
    home = topology.place(message.sender)
    may = [keys is None or _key(message) in keys for keys in listed]
    tree = {hop.target: hop for hop in _breadth_first(topology, home, may)}
    needed: set[int] = set()
    for receiver in filter(NODES.__contains__, message.receivers):
        segment = topology.place(receiver)
        if segment != home and segment not in tree:
            raise CanrollError(
                f"{message.name} does not get from segment '{topology.segments[home].name}' to "
                f"{receiver} on '{topology.segments[segment].name}': no gateway passes it on"
            )
        while segment != home:
            needed.add(tree[segment].gateway)
            segment = tree[segment].source
    passes = [
        number in needed if keys is None else may[number] for number, keys in enumerate(listed)
    ]
    return _flooded(topology, message, home, passes)


def _flooded(
    topology: Topology, message: BusMessage, home: int, passes: Sequence[bool]
) -> RoutedMessage:
    """The way of a message over all gateways that pass it on."""
    hops = tuple(_breadth_first(topology, home, passes))
    reached = {home, *(hop.target for hop in hops)}
    used = {hop.gateway for hop in hops}
    for number, gateway in enumerate(topology.gateways):
        if passes[number] and number not in used and reached.issuperset(gateway.segments):
            raise CanrollError(
                f"gateway '{gateway.name}': {message.name} returns by it to a segment that it "
                "has been on: take it out of the messages of one gateway"
            )
    return RoutedMessage(message, home, hops)


def _breadth_first(topology: Topology, home: int, passes: Sequence[bool]) -> Iterator[Hop]:
    """Yield the hops of a frame from ``home`` to every segment that it reaches first so."""
    reached, edge = {home}, [home]
    while edge:
        source = edge.pop(0)
        for number, gateway in enumerate(topology.gateways):
            if not passes[number] or source not in gateway.segments:
                continue
            first, second = gateway.segments
            target = second if source == first else first
            if target not in reached:
                reached.add(target)
                edge.append(target)
                yield Hop(number, source, target)


def _check_identifiers(topology: Topology, routed: Sequence[RoutedMessage], own: int) -> None:
    """Refuse two messages of one identifier on a segment, unless both are its background."""
    for segment, place in enumerate(topology.segments):
        seen: dict[int, tuple[str, bool]] = {}
        for number, route in enumerate(routed):
            if segment not in route.segments:
                continue
            message = route.message
            comes = number < own or route.home != segment
            other, came = seen.setdefault(message.arbitration_key, (message.name, comes))
            if other != message.name and (comes or came):
                raise CanrollError(
                    f"segment '{place.name}': {other} and {message.name} both have identifier "
                    f"0x{message.ident:X}: give our signals other frames (--dbc, --map), or the "
                    "gateways other messages"
                )
