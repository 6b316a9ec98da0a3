"""Description of a bus network, and the arrays made from it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.buses.topology import BITRATES, DATA_BITRATE_MAX, PUNCTUAL, TimeSpread
from canroll.plant_sim.can_bus.kernel import layout
from canroll.plant_sim.can_bus.kernel.layout import Network, Records
from canroll.plant_sim.can_bus.kernel.sources import start_source
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, FD, arbitration_key
from canroll.plant_sim.kernels.instants import NEVER

POLICIES: Final = {"priority": layout.PRIORITY, "fifo": layout.FIFO, "replace": layout.REPLACE}
FAULTS: Final = {
    "node_down": layout.NODE_DOWN,
    "node_delay": layout.NODE_DELAY,
    "gateway_down": layout.GATEWAY_DOWN,
    "disturb": layout.DISTURB,
    "overload": layout.OVERLOAD,
    "refuse": layout.REFUSE,
    "node_mute": layout.NODE_MUTE,
    "bit_errors": layout.BIT_ERRORS,
}
MAX_CAPACITY: Final = layout.MAX_FRAMES


@dataclass(frozen=True, slots=True)
class Segment:
    """One bus: bit rates in bit/s, propagation delay, probability that a bit is disturbed."""

    bitrate: int
    data_bitrate: int = 0
    propagation_ns: int = 0
    bit_error_rate: float = 0.0


@dataclass(frozen=True, slots=True)
class Node:
    """A controller on a segment.

    ``policy`` of its transmit queue: ``priority`` (all frames compete), ``fifo`` (only the oldest
    does), ``replace`` (as priority; a newer frame of a message takes the place of a waiting one).
    ``drift_ppm`` stretches the periods of its sources; ``recovers``: rejoins after bus-off.
    ``jitter``: delay between handing over and queueing of its frames, in their order.
    """

    name: str
    segment: int = 0
    policy: str = "replace"
    capacity: int = 256
    drift_ppm: float = 0.0
    single_shot: bool = False
    recovers: bool = True
    jitter: TimeSpread = PUNCTUAL


@dataclass(frozen=True, slots=True)
class Source:
    """Frames that a node queues periodically: offset + k·period + jitter·U[0, 1].

    ``payload`` None: random bytes in every frame. Active from ``offset_ns`` until ``until_ns``.
    ``bits`` above 0 gives every frame that length, interframe space included, whatever it holds.
    """

    node: str
    ident: int
    length: int
    period_ns: float
    offset_ns: int = 0
    jitter_ns: int = 0
    flags: int = 0
    payload: bytes | None = None
    until_ns: int = NEVER
    bits: int = 0


@dataclass(frozen=True, slots=True)
class Gateway:
    """Store and forward from one node's segment to another node, with latency, order kept.

    ``idents``: identifiers and flags that it forwards, None: all. Frames are queued on the far side
    in the order of their reception, whatever latency is drawn.
    """

    from_node: str
    to_node: str
    latency: TimeSpread
    idents: tuple[tuple[int, int], ...] | None = None


@dataclass(frozen=True, slots=True)
class BusFault:
    """A scripted fault, active from ``from_ns`` until before ``until_ns``.

    ``kind``: ``node_down`` (it neither sends nor hears), ``node_mute`` (it hears but does not send)
    and ``node_delay`` (by ``value`` ns) of node ``target``; ``bit_errors``: every bit is disturbed
    with probability ``rate`` on segment ``target`` (None: on all);
    ``gateway_down`` of gateway number ``target``; ``disturb``: bit ``value`` of the next ``count``
    attempts of node ``target`` (None: any node) with identifier ``ident`` (None: any);
    ``overload``: an overload frame behind the next ``count`` frames of segment ``target``;
    ``refuse``: node ``target``, a receiver, alone sees an error in the last but one bit of EOF of
    the next ``count`` attempts with identifier ``ident`` (None: any).
    """

    kind: str
    target: str | int | None = None
    from_ns: int = 0
    until_ns: int = NEVER
    ident: int | None = None
    value: int = 20
    count: int = -1
    rate: float = 0.0


@dataclass(frozen=True, slots=True)
class NetworkSpec:
    """Description of a network; capacities limit its memory."""

    segments: tuple[Segment, ...]
    nodes: tuple[Node, ...]
    sources: tuple[Source, ...] = ()
    gateways: tuple[Gateway, ...] = ()
    faults: tuple[BusFault, ...] = ()
    seed: int = 0
    log_capacity: int = 1 << 14


def _number(names: Sequence[str], name: str) -> int:
    if name not in names:
        raise UnknownNameError("bus node", name, names)
    return names.index(name)


def _code(what: str, choices: dict[str, int], name: str) -> int:
    if name not in choices:
        raise UnknownNameError(what, name, choices)
    return choices[name]


def _check(spec: NetworkSpec) -> None:
    routes = max((len(gateway.idents or ()) for gateway in spec.gateways), default=0)
    for what, count, room in (
        ("segments", len(spec.segments), layout.MAX_SEGMENTS),
        ("nodes", len(spec.nodes), layout.MAX_NODES),
        ("periodic messages", len(spec.sources), layout.MAX_SOURCES),
        ("gateways", len(spec.gateways), layout.MAX_GATEWAYS),
        ("identifiers routed by a gateway", routes, layout.MAX_ROUTES),
        ("faults", len(spec.faults), layout.MAX_FAULTS),
        ("log entries", spec.log_capacity, layout.MAX_LOG),
    ):
        if count > room:
            raise CanrollError(f"a network holds at most {room} {what}, got {count}")
    for segment in spec.segments:
        check_rates(segment.bitrate, segment.data_bitrate)
        if not 0.0 <= segment.bit_error_rate < 1.0:
            raise CanrollError(
                f"the bit error rate must be in [0, 1), got {segment.bit_error_rate}"
            )
    for node in spec.nodes:
        if not 0 <= node.segment < len(spec.segments):
            raise CanrollError(
                f"node '{node.name}' is on segment {node.segment}, which does not exist"
            )
    for source in spec.sources:
        if source.period_ns <= 0:
            raise CanrollError(f"message 0x{source.ident:X}: the period must be positive")
        check_frame(source.ident, source.length, source.flags)


def check_rates(bitrate: int, data_bitrate: int) -> None:
    """Reject invalid bit rates; a ``data_bitrate`` of 0 means none."""
    if bitrate <= 0:
        raise CanrollError(f"the bit rate must be positive, got {bitrate} bit/s")
    if bitrate > BITRATES[1]:
        raise CanrollError(f"the bit rate must be at most {BITRATES[1]} bit/s, got {bitrate}")
    if data_bitrate > DATA_BITRATE_MAX:
        raise CanrollError(
            f"the data bit rate must be at most {DATA_BITRATE_MAX} bit/s, got {data_bitrate}"
        )
    if data_bitrate and data_bitrate < bitrate:
        raise CanrollError(
            f"the data bit rate must be at least the {bitrate} bit/s of arbitration, got "
            f"{data_bitrate}"
        )


def check_frame(ident: int, length: int, flags: int) -> None:
    """Reject invalid identifiers and payload lengths."""
    if not 0 <= ident < (1 << 29 if flags & EXTENDED else 1 << 11):
        raise CanrollError(
            f"identifier 0x{ident:X} does not fit in {29 if flags & EXTENDED else 11} bits"
        )
    if not 0 <= length <= (64 if flags & FD else 8):
        raise CanrollError(f"message 0x{ident:X}: {length} is not a valid payload length in bytes")


def build_network(spec: NetworkSpec) -> Network:
    """Return the arrays of a network at time 0, its sources scheduled.

    Raises:
        CanrollError: impossible bit rates, identifiers, lengths or periods.
        UnknownNameError: a node, policy or fault that does not exist.
    """
    _check(spec)
    network = layout.empty(log=spec.log_capacity, seed=spec.seed)
    clock = network.clock
    clock[layout.SEGMENT_COUNT] = len(spec.segments)
    clock[layout.GATEWAY_COUNT] = len(spec.gateways)
    for i, segment in enumerate(spec.segments):
        for key in ("bitrate", "data_bitrate", "propagation_ns", "bit_error_rate"):
            network.segments[key][i] = getattr(segment, key)
        exact = segment.bitrate > 0 and 10**9 % segment.bitrate == 0
        network.segments["bit_ns"][i] = 10**9 // segment.bitrate if exact else 0
    names = [node.name for node in spec.nodes]
    for node in spec.nodes:
        add_node(network, node)
    _add_gateways(network, spec, names)
    for fault in spec.faults:
        add_fault(network, fault, names)
    for source in spec.sources:
        add_source(network, source, _number(names, source.node))
    return network


def add_source(network: Network, source: Source, node: int) -> None:
    """Add a periodic message of ``node`` to a network, at any time.

    Raises:
        CanrollError: there is no room for another one.
    """
    number = int(network.clock[layout.SOURCE_COUNT])
    if number >= layout.MAX_SOURCES:
        raise CanrollError(f"a network holds at most {layout.MAX_SOURCES} periodic messages")
    network.clock[layout.SOURCE_COUNT] = number + 1
    record = network.part("sources")[number : number + 1]
    record["node"] = node
    for key in (
        *("ident", "flags", "length", "bits", "period_ns", "offset_ns", "jitter_ns", "until_ns"),
    ):
        record[key] = getattr(source, key)
    record["random_payload"] = source.payload is None
    if source.payload is not None:
        stored = np.frombuffer(source.payload, np.uint8)
        network.part("source_payloads")[number, : len(stored)] = stored
    start_source(network, number)


def add_node(network: Network, node: Node) -> int:
    """Add a node to a network, at any time, and return its number.

    Raises:
        CanrollError: there is no room for another node.
    """
    number = int(network.clock[layout.NODE_COUNT])
    if number >= layout.MAX_NODES:
        raise CanrollError(f"a network holds at most {layout.MAX_NODES} nodes")
    network.clock[layout.NODE_COUNT] = number + 1
    record = network.nodes[number : number + 1]
    record["segment"] = node.segment
    record["policy"] = _code("queue policy", POLICIES, node.policy)
    record["capacity"] = node.capacity
    record["drift"] = node.drift_ppm * 1e-6
    record["single_shot"] = node.single_shot
    record["recovers"] = node.recovers
    _draw_from(network, record, node.jitter)
    return number


def _draw_from(network: Network, record: Records, spread: TimeSpread) -> None:
    """Fill in a time that is drawn for every frame."""
    first, count = int(network.clock[layout.SAMPLES]), len(spread.samples_ns)
    if first + count > layout.MAX_SAMPLES:
        raise CanrollError(f"a network holds at most {layout.MAX_SAMPLES} measured times")
    network.part("samples")[first : first + count] = spread.samples_ns
    network.clock[layout.SAMPLES] = first + count
    record["low_ns"], record["high_ns"] = spread.low_ns, spread.high_ns
    record["first_sample"], record["samples"] = first, count


def _add_gateways(network: Network, spec: NetworkSpec, names: Sequence[str]) -> None:
    for i, gateway in enumerate(spec.gateways):
        record = network.part("gateways")[i : i + 1]
        record["from_node"] = _number(names, gateway.from_node)
        record["to_node"] = _number(names, gateway.to_node)
        _draw_from(network, record, gateway.latency)
        record["routes"] = -1 if gateway.idents is None else len(gateway.idents)
        for j, (ident, flags) in enumerate(gateway.idents or ()):
            network.part("routes")[i, j] = arbitration_key(ident, flags)


def add_fault(network: Network, fault: BusFault, names: Sequence[str] = ()) -> None:
    """Add a fault to a network, at any time; ``names`` are those of its nodes.

    Raises:
        CanrollError: there is no room for another fault, or its target is missing.
        UnknownNameError: no such kind or node.
    """
    number = int(network.clock[layout.FAULT_COUNT])
    if number >= layout.MAX_FAULTS:
        raise CanrollError(f"a network holds at most {layout.MAX_FAULTS} faults")
    network.clock[layout.FAULT_COUNT] = number + 1
    record = network.part("faults")[number : number + 1]
    record["kind"] = _code("bus fault", FAULTS, fault.kind)
    if fault.kind == "refuse" and fault.target is None:
        raise CanrollError("bus fault 'refuse' needs a target node")
    target = -1 if fault.target is None else fault.target
    record["target"] = _number(names, target) if isinstance(target, str) else target
    record["from_ns"], record["until_ns"] = fault.from_ns, fault.until_ns
    record["ident"] = -1 if fault.ident is None else fault.ident
    record["value"], record["left"] = fault.value, fault.count
    record["rate"] = fault.rate
