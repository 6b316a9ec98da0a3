"""Simulated response times of a traffic set."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

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
from plant_sim.can_bus.traffic.log_playback import Recording, feed
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import ERROR_STATE, worst_case_bits

_CHUNK_NS: Final = 200_000_000
LISTENER: Final = "Listener"


@dataclass(frozen=True, slots=True)
class SimulatedResponse:
    """Response times of one message in nanoseconds, queueing to end of the interframe space."""

    name: str
    responses: NDArray[np.int64]

    def quantile(self, share: float) -> float:
        """Return the response that ``share`` of the frames keep; not a number without frames."""
        return float(np.quantile(self.responses, share)) if len(self.responses) else float("nan")


@dataclass(frozen=True, slots=True)
class Simulation:
    """Results of a bus simulation: responses by message, load, and frame balance."""

    responses: dict[str, SimulatedResponse]
    load: float
    frames: int
    balanced: bool


def longest(message: BusMessage) -> BusMessage:
    """Fix a frame's length at its worst; with bit-rate switch the actual bits have to decide."""
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

    A sender with a FIFO message queues all of its messages first in, first out. Another node
    listens and acknowledges.
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


def add_player(network: Network) -> int:
    """Put a node on a network that replays a recording, and return its number."""
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
        worst_case_lengths: send every classic frame with the most stuff bits it can have.
        recording: replayed beside the set; its frames count towards load and account alone.
    """
    spec = traffic_spec(
        messages,
        bitrate=bitrate,
        data_bitrate=data_bitrate,
        seed=seed,
        worst_case_lengths=worst_case_lengths,
    )
    network = build_network(spec)
    player = add_player(network)
    replayed = 0
    names: dict[tuple[str, int, int], list[str]] = {}
    for message in messages:
        names.setdefault((message.sender, message.ident, message.flags), []).append(message.name)
    nodes = [node.name for node in spec.nodes]
    collected: dict[str, list[NDArray[np.int64]]] = {m.name: [] for m in messages}
    cursor = frames = 0
    end = round(duration_s * 1e9)
    for now in range(_CHUNK_NS, end + _CHUNK_NS, _CHUNK_NS):
        if recording is not None:
            replayed = feed(network, recording.frames, player, replayed, min(now, end))
        advance(network, min(now, end))
        entries, cursor, _ = drain(network, cursor)
        entries = entries[entries["outcome"] == DELIVERED]
        frames += len(entries)
        entries = entries[entries["sender"] != player]
        response = entries["t_end"] - entries["t_queued"]
        keys = np.stack([entries[f].astype(np.int64) for f in ("sender", "ident", "flags")])
        keys[2] &= ~ERROR_STATE
        for sender, ident, flags in np.unique(keys, axis=1).T:
            chosen = (keys == np.array([[sender], [ident], [flags]])).all(axis=0)
            for name in names[nodes[sender], int(ident), int(flags)]:
                collected[name].append(response[chosen])
    return Simulation(
        {
            n: SimulatedResponse(n, np.concatenate([*r, []]).astype(int))
            for n, r in collected.items()
        },
        load(network, 0),
        frames,
        account(network, 0).balanced,
    )
