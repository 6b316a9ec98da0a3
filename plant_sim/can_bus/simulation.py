"""Simulated response times of a traffic set, and sample-to-force ages over a bus."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from plant_sim.can_bus.kernel.account import account, drain, load
from plant_sim.can_bus.kernel.layout import DELIVERED, Network, logged
from plant_sim.can_bus.kernel.network import (
    MAX_CAPACITY,
    NetworkSpec,
    Node,
    Segment,
    add_node,
    build_network,
)
from plant_sim.can_bus.kernel.queues import enqueue
from plant_sim.can_bus.kernel.scheduler import advance
from plant_sim.can_bus.traffic.log_playback import Recording, feed
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import worst_case_bits

_CHUNK_NS: Final = 200_000_000
_LISTENER: Final = "Listener"


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
    """What a simulated bus did: responses by message, load, and whether the account balances."""

    responses: dict[str, SimulatedResponse]
    load: float
    frames: int
    balanced: bool


def _longest(message: BusMessage) -> BusMessage:
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
        messages = [_longest(message) for message in messages]
    fifo = {m.sender for m in messages if m.fifo}
    senders = dict.fromkeys(m.sender for m in messages)
    nodes = [
        Node(name, policy="fifo" if name in fifo else "priority", capacity=MAX_CAPACITY)
        for name in senders
    ]
    return NetworkSpec(
        segments=(Segment(bitrate, data_bitrate),),
        nodes=(*nodes, Node(_LISTENER)),
        sources=tuple(message.source() for message in messages),
        seed=seed,
        log_capacity=log_capacity,
    )


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
    player = add_node(network, Node("Recording", policy="priority", capacity=MAX_CAPACITY))
    replayed = 0
    names = {(m.sender, m.ident, m.flags): m.name for m in messages}
    nodes = [node.name for node in spec.nodes]
    collected: dict[str, list[NDArray[np.int64]]] = {m.name: [] for m in messages}
    cursor = frames = 0
    end = round(duration_s * 1e9)
    for now in range(_CHUNK_NS, end + _CHUNK_NS, _CHUNK_NS):
        if recording is not None:
            replayed = feed(network, recording, player, replayed, min(now, end))
        advance(network, min(now, end))
        entries, cursor, _ = drain(network, cursor)
        entries = entries[entries["outcome"] == DELIVERED]
        frames += len(entries)
        entries = entries[entries["sender"] != player]
        response = entries["t_end"] - entries["t_queued"]
        keys = np.stack([entries[f].astype(np.int64) for f in ("sender", "ident", "flags")])
        for sender, ident, flags in np.unique(keys, axis=1).T:
            chosen = (keys == np.array([[sender], [ident], [flags]])).all(axis=0)
            collected[names[nodes[sender], int(ident), int(flags)]].append(response[chosen])
    return Simulation(
        {
            n: SimulatedResponse(n, np.concatenate([*r, []]).astype(int))
            for n, r in collected.items()
        },
        load(network, 0),
        frames,
        account(network, 0).balanced,
    )


@dataclass(frozen=True, slots=True)
class Loop:
    """A control loop over a bus: node numbers, identifiers, and periods in nanoseconds."""

    sensor_node: int
    sensor_ident: int
    command_node: int
    command_ident: int
    actuator_node: int
    sensor_ns: int
    tick_ns: int
    actuator_ns: int = 1_000_000
    tick_offset_ns: int = 0
    run_time_ns: int = 0


def simulate_ages(network: Network, loop: Loop, *, duration_ns: int) -> NDArray[np.int64]:
    """Return the sample-to-force age of every command that the actuator applied, nanoseconds.

    A sensor samples and sends; in every tick the ECU sends a command computed from the newest
    sample it has received; the actuator looks at what it has received once a period. The age runs
    from the sample to that look.
    """
    home = int(network.nodes["segment"][loop.command_node])
    far = int(network.nodes["segment"][loop.actuator_node])
    payload = np.zeros(8, np.uint8)
    ages: list[int] = []
    newest, cursor = -1, 0
    sampled: dict[int, int] = {}
    waiting = -1
    sample, tick, look = 0, loop.tick_offset_ns, 0
    while True:
        now = min(sample, tick, look)
        if now > duration_ns:
            return np.array(ages, np.int64)
        advance(network, now)
        assert logged(network) - cursor <= len(network.log)
        entries, cursor, _ = drain(network, cursor)
        for entry in entries[entries["outcome"] == DELIVERED]:
            if entry["ident"] == loop.sensor_ident and entry["segment"] == home:
                newest = max(newest, int(entry["t_origin"]))
            elif entry["ident"] == loop.command_ident and entry["segment"] == far:
                waiting = sampled[int(entry["t_origin"])]
        if now == look:
            if waiting >= 0:
                ages.append(now - waiting)
                waiting = -1
            look += loop.actuator_ns
        if now == tick:
            if newest >= 0:
                sampled[now + loop.run_time_ns] = newest
                queued = now + loop.run_time_ns
                enqueue(network, loop.command_node, queued, loop.command_ident, 8, payload)
            tick += loop.tick_ns
        if now == sample:
            payload[:] = np.frombuffer(int(now).to_bytes(8, "little"), np.uint8)
            enqueue(network, loop.sensor_node, now, loop.sensor_ident, 8, payload)
            sample += loop.sensor_ns
