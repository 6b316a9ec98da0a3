"""Simulated response times on a network; a traffic set is one of a single segment."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.buses.topology import Topology
from canroll.plant_sim.can_bus.kernel.layout import DELIVERED, Network
from canroll.plant_sim.can_bus.kernel.ledger import account, drain, load
from canroll.plant_sim.can_bus.kernel.network import (
    MAX_CAPACITY,
    NetworkSpec,
    Node,
    add_node,
    build_network,
)
from canroll.plant_sim.can_bus.kernel.scheduler import advance
from canroll.plant_sim.can_bus.network.network_spec import network_spec
from canroll.plant_sim.can_bus.network.routing import RoutedNetwork
from canroll.plant_sim.can_bus.traffic.log_playback import Recording, feed
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import ERROR_STATE, worst_case_bits

_CHUNK_NS: Final = 200_000_000
LISTENER: Final = "Listener"


def with_longest(network: RoutedNetwork) -> RoutedNetwork:
    """Return a network whose frames have their greatest length, except with bit-rate switch."""
    return replace(
        network,
        messages=[replace(r, message=_longest(r.message)) for r in network.messages],
    )


def _longest(message: BusMessage) -> BusMessage:
    nominal, data = worst_case_bits(message.length, message.flags)
    return message if message.bits or data else replace(message, bits=nominal)


def traffic_spec(
    messages: Sequence[BusMessage],
    *,
    bitrate: int,
    data_bitrate: int = 0,
    seed: int = 0,
    log_capacity: int = 1 << 15,
) -> NetworkSpec:
    """Return a network of one segment that sends ``messages``, one node for every sender.

    If one message of a sender is FIFO, all messages of that sender are. A further node, the last,
    listens and acknowledges.
    """
    bus = RoutedNetwork.one_bus(messages, bitrate=bitrate, data_bitrate=data_bitrate)
    spec = network_spec(bus, seed=seed)
    return replace(spec, nodes=(*spec.nodes, Node(LISTENER)), log_capacity=log_capacity)


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
    entries: NDArray[np.void],
) -> Iterator[tuple[tuple[int, int, int, int], NDArray[np.void]]]:
    """Yield segment, sender, identifier and flags, and the entries with them."""
    fields = ("segment", "sender", "ident", "flags")
    keys = np.stack([entries[field].astype(np.int64) for field in fields])
    keys[3] &= ~ERROR_STATE
    for key in np.unique(keys, axis=1).T:
        segment, sender, ident, flags = (int(part) for part in key)
        chosen = entries[(keys == key[:, np.newaxis]).all(axis=0)]
        yield (segment, sender, ident, flags), chosen


def add_player(network: Network) -> int:
    """Add a node for replaying a recording, and return its number."""
    return add_node(network, Node("Recording", policy="priority", capacity=MAX_CAPACITY))


class SimulatedArrival(NamedTuple):
    """Times of a message's delivered frames on one segment of a network, nanoseconds.

    Both end with the interframe space. ``here``: from queueing on this segment; ``end_to_end``:
    from queueing by the original sender.
    """

    here: NDArray[np.int64]
    end_to_end: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class NetworkSimulation:
    """Results of a simulated network.

    ``arrivals``: of each message, by segment number. Of each segment ``loads`` (0 to 1),
    ``frames``: number delivered, and ``balanced``: whether every queued frame is accounted for.
    """

    arrivals: list[dict[int, SimulatedArrival]]
    loads: list[float]
    frames: list[int]
    balanced: list[bool]


def simulate_network(
    routed: RoutedNetwork,
    *,
    duration_s: float,
    seed: int = 0,
    worst_case_lengths: bool = False,
    recording: Recording | None = None,
) -> NetworkSimulation:
    """Simulate the messages of a network on every segment that they reach.

    Messages of one node with the same identifier share their times.

    Args:
        routed: the network.
        duration_s: simulated time.
        seed: of jitter, payloads and latencies.
        worst_case_lengths: send classic frames with the maximum number of stuff bits.
        recording: replayed on the first segment; its frames count only in load and account.
    """
    if worst_case_lengths:
        routed = with_longest(routed)
    spec = network_spec(routed, nodes=listeners(routed.topology), seed=seed)
    network = build_network(spec)
    nodes = {node.name: number for number, node in enumerate(spec.nodes)}
    sharing: dict[tuple[int, int, int, int], list[tuple[int, int]]] = {}
    for number, r in enumerate(routed.messages):
        for segment in r.segments:
            node = nodes[routed.sender_on(r, segment)]
            key = segment, node, r.message.ident, r.message.flags
            sharing.setdefault(key, []).append((number, segment))
    here: dict[tuple[int, int], list[NDArray[np.int64]]] = {
        place: [] for places in sharing.values() for place in places
    }
    end_to_end = {place: list(parts) for place, parts in here.items()}
    segments = range(len(routed.topology.segments))
    frames = [0 for _ in segments]
    for entries in delivered(network, round(duration_s * 1e9), recording):
        for key, chosen in _by_message(entries):
            frames[key[0]] += len(chosen)
            # the frames of a recording are no message's
            for place in sharing.get(key, ()):
                here[place].append(chosen["t_end"] - chosen["t_queued"])
                end_to_end[place].append(chosen["t_end"] - chosen["t_origin"])
    arrivals = [
        {
            segment: SimulatedArrival(
                _joined(here[number, segment]), _joined(end_to_end[number, segment])
            )
            for segment in r.segments
        }
        for number, r in enumerate(routed.messages)
    ]
    return NetworkSimulation(
        arrivals,
        [load(network, segment) for segment in segments],
        frames,
        [account(network, segment).balanced for segment in segments],
    )


def listeners(topology: Topology) -> list[Node]:
    """Return one listening node for each segment, so that every frame is acknowledged."""
    return [Node(f"{LISTENER}{number}", number) for number in range(len(topology.segments))]


def _joined(parts: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    return np.concatenate([*parts, np.array([], np.int64)])
