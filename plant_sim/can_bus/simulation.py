"""Simulated response times of a traffic set, and of a network with gateways."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from plant_sim.buses.topology import Topology
from plant_sim.can_bus.kernel.layout import DELIVERED, Network
from plant_sim.can_bus.kernel.ledger import account, drain, load
from plant_sim.can_bus.kernel.network import (
    MAX_CAPACITY,
    NetworkSpec,
    Node,
    Segment,
    add_node,
    build_network,
)
from plant_sim.can_bus.kernel.scheduler import advance
from plant_sim.can_bus.network_spec import network_spec
from plant_sim.can_bus.routing import RoutedMessage
from plant_sim.can_bus.traffic.log_playback import Recording, feed
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import ERROR_STATE, worst_case_bits

_CHUNK_NS: Final = 200_000_000
LISTENER: Final = "Listener"


@dataclass(frozen=True, slots=True)
class SimulatedResponse:
    """Response times of one message, from queueing to the end of the interframe space, in ns."""

    name: str
    responses: NDArray[np.int64]

    def quantile(self, share: float) -> float:
        """Return the quantile ``share`` (0 to 1) of the responses, ns; NaN without frames."""
        return float(np.quantile(self.responses, share)) if len(self.responses) else float("nan")


@dataclass(frozen=True, slots=True)
class Simulation:
    """Results of a bus simulation: responses by message, load, and frame balance."""

    responses: dict[str, SimulatedResponse]
    load: float
    frames: int
    balanced: bool


def longest(message: BusMessage) -> BusMessage:
    """Return the message with its greatest frame length; unchanged with bit-rate switch."""
    nominal, data = worst_case_bits(message.length, message.flags)
    return message if message.bits or data else replace(message, bits=nominal)


def traffic_spec(
    messages: Sequence[BusMessage],
    *,
    bitrate: int,
    data_bitrate: int = 0,
    seed: int = 0,
    worst_case_lengths: bool = False,
    log_capacity: int = 1 << 15,
) -> NetworkSpec:
    """Return a network of one segment that sends ``messages``, one node for every sender.

    If one message of a sender is FIFO, all messages of that sender are. A further node listens and
    acknowledges.
    """
    if worst_case_lengths:
        messages = [longest(message) for message in messages]
    fifo = {m.sender for m in messages if m.fifo}
    senders = dict.fromkeys(m.sender for m in messages)
    nodes = [
        Node(name, policy="fifo" if name in fifo else "priority", capacity=MAX_CAPACITY)
        for name in senders
    ]
    return NetworkSpec(
        segments=(Segment(bitrate, data_bitrate),),
        nodes=(*nodes, Node(LISTENER)),
        sources=tuple(message.source() for message in messages),
        seed=seed,
        log_capacity=log_capacity,
    )


def delivered(
    network: Network, end_ns: int, recording: Recording | None = None
) -> Iterator[NDArray[np.void]]:
    """Advance a network to ``end_ns``, and yield the log entries of the delivered frames.

    ``recording``: replayed by a further node on the first segment, which has the last number.
    """
    player = -1 if recording is None else add_player(network)
    cursor = replayed = 0
    for now in range(_CHUNK_NS, end_ns + _CHUNK_NS, _CHUNK_NS):
        if recording is not None:
            replayed = feed(network, recording.frames, player, replayed, min(now, end_ns))
        advance(network, min(now, end_ns))
        entries, cursor, _ = drain(network, cursor)
        yield entries[entries["outcome"] == DELIVERED]


def _by_message(
    entries: NDArray[np.void], place: str
) -> Iterator[tuple[tuple[int, int, int], NDArray[np.void]]]:
    """Yield ``place`` (``sender`` or ``segment``), identifier, flags, and the entries with them."""
    keys = np.stack([entries[f].astype(np.int64) for f in (place, "ident", "flags")])
    keys[2] &= ~ERROR_STATE
    for key in np.unique(keys, axis=1).T:
        number, ident, flags = (int(part) for part in key)
        yield (number, ident, flags), entries[(keys == key[:, np.newaxis]).all(axis=0)]


def add_player(network: Network) -> int:
    """Add a node for replaying a recording, and return its number."""
    return add_node(network, Node("Recording", policy="priority", capacity=MAX_CAPACITY))


def simulate(
    messages: Sequence[BusMessage],
    *,
    bitrate: int,
    duration_s: float,
    data_bitrate: int = 0,
    seed: int = 0,
    worst_case_lengths: bool = False,
    recording: Recording | None = None,
) -> Simulation:
    """Simulate a traffic set and return the response time of every frame.

    Messages of one node with the same identifier share their responses.

    Args:
        messages: periodic messages with offsets and jitter.
        bitrate: nominal bit rate, bit/s.
        duration_s: simulated time.
        data_bitrate: of FD frames with bit-rate switch, 0: as nominal.
        seed: of jitter and payloads.
        worst_case_lengths: send classic frames with the maximum number of stuff bits.
        recording: replayed in addition; its frames count only in load and account.
    """
    spec = traffic_spec(
        messages,
        bitrate=bitrate,
        data_bitrate=data_bitrate,
        seed=seed,
        worst_case_lengths=worst_case_lengths,
    )
    network = build_network(spec)
    names: dict[tuple[str, int, int], list[str]] = {}
    for message in messages:
        names.setdefault((message.sender, message.ident, message.flags), []).append(message.name)
    nodes = [node.name for node in spec.nodes]
    collected: dict[str, list[NDArray[np.int64]]] = {m.name: [] for m in messages}
    frames = 0
    for entries in delivered(network, round(duration_s * 1e9), recording):
        frames += len(entries)
        for (sender, ident, flags), chosen in _by_message(entries, "sender"):
            # the frames of a recording are no message's
            for name in names[nodes[sender], ident, flags] if sender < len(nodes) else ():
                collected[name].append(chosen["t_end"] - chosen["t_queued"])
    return Simulation(
        {name: _joined(name, parts) for name, parts in collected.items()},
        load(network, 0),
        frames,
        account(network, 0).balanced,
    )


@dataclass(frozen=True, slots=True)
class SimulatedArrival:
    """Times of a message's delivered frames on one segment of a network, nanoseconds.

    Both end with the interframe space. ``here``: from queueing on this segment; ``whole``: from
    queueing by the original sender.
    """

    here: SimulatedResponse
    whole: SimulatedResponse


@dataclass(frozen=True, slots=True)
class NetworkSimulation:
    """Results of a simulated network.

    ``arrivals``: of each message, by segment number; ``loads``: of each segment, 0 to 1;
    ``frames``: delivered on all segments together.
    """

    arrivals: list[dict[int, SimulatedArrival]]
    loads: list[float]
    frames: int


def simulate_network(
    topology: Topology,
    routed: Sequence[RoutedMessage],
    *,
    duration_s: float,
    seed: int = 0,
    worst_case_lengths: bool = False,
) -> NetworkSimulation:
    """Simulate the messages of a network on every segment that they reach.

    Args:
        topology: segments and gateways.
        routed: all messages with their routes.
        duration_s: simulated time.
        seed: of jitter, payloads and latencies.
        worst_case_lengths: send classic frames with the maximum number of stuff bits.
    """
    sent = (
        [replace(r, message=longest(r.message)) for r in routed] if worst_case_lengths else routed
    )
    spec = network_spec(topology, sent, nodes=listeners(topology), seed=seed)
    network = build_network(spec)
    numbers = {
        (segment, r.message.ident, r.message.flags): number
        for number, r in enumerate(routed)
        for segment in r.segments
    }
    here: dict[tuple[int, int], list[NDArray[np.int64]]] = {
        (number, segment): [] for number, r in enumerate(routed) for segment in r.segments
    }
    whole = {key: list(parts) for key, parts in here.items()}
    frames = 0
    for entries in delivered(network, round(duration_s * 1e9)):
        frames += len(entries)
        for (segment, ident, flags), chosen in _by_message(entries, "segment"):
            key = numbers[segment, ident, flags], segment
            here[key].append(chosen["t_end"] - chosen["t_queued"])
            whole[key].append(chosen["t_end"] - chosen["t_origin"])
    arrivals = [
        {
            segment: SimulatedArrival(
                _joined(r.message.name, here[number, segment]),
                _joined(r.message.name, whole[number, segment]),
            )
            for segment in r.segments
        }
        for number, r in enumerate(routed)
    ]
    loads = [load(network, segment) for segment in range(len(topology.segments))]
    return NetworkSimulation(arrivals, loads, frames)


def listeners(topology: Topology) -> list[Node]:
    """Return one listening node for each segment, so that every frame is acknowledged."""
    return [Node(f"{LISTENER}{number}", number) for number in range(len(topology.segments))]


def _joined(name: str, parts: Sequence[NDArray[np.int64]]) -> SimulatedResponse:
    return SimulatedResponse(name, np.concatenate([*parts, np.array([], np.int64)]))
