"""Simulated ages: from a sensor's sample to the instant the resulting command is applied."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from plant_sim.buses.topology import Topology
from plant_sim.can_bus.delay_bounds import loop_messages
from plant_sim.can_bus.kernel.layout import MAX_PAYLOAD, SEED, Network, logged
from plant_sim.can_bus.kernel.ledger import drain, took
from plant_sim.can_bus.kernel.network import NetworkSpec, build_network
from plant_sim.can_bus.kernel.queues import enqueue
from plant_sim.can_bus.kernel.scheduler import advance
from plant_sim.can_bus.network_spec import network_spec
from plant_sim.can_bus.routing import RoutedMessage
from plant_sim.can_bus.simulation import LISTENER, add_player, listeners, longest, traffic_spec
from plant_sim.can_bus.traffic.log_playback import Frames, Recording, feed
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import EXTENDED
from plant_sim.kernels.random import random_bits, uniform

_JITTER_STREAM: Final = 1 << 44
_PAYLOAD_STREAM: Final = 1 << 45


@dataclass(frozen=True, slots=True)
class Loop:
    """A control loop over a bus: its two messages, the numbers of its nodes, times in nanoseconds.

    The command is sent in every tick, whatever its period. Both messages are queued with a delay of
    up to their jitter.
    """

    sensor: BusMessage
    command: BusMessage
    sensor_node: int
    command_node: int
    actuator_node: int
    tick_ns: int
    tick_offset_ns: int = 0
    actuator_ns: int = 1_000_000


class _Sender:
    """Queues the frames of one message in order, with random payload and jitter."""

    def __init__(self, network: Network, node: int, message: BusMessage) -> None:
        self.network, self.node, self.message = network, node, message
        self.payload = np.zeros(MAX_PAYLOAD, np.uint8)
        self.sent, self.last_ns = 0, -1

    def send(self, nominal_ns: int) -> int:
        """Queue the frame with nominal release ``nominal_ns``; return the time of queueing, ns."""
        message, seed = self.message, int(self.network.clock[SEED])
        draw = float(uniform(seed, _JITTER_STREAM + message.ident, self.sent))
        queued = max(nominal_ns + int(draw * (message.jitter_ns + 1)), self.last_ns + 1)
        words = [
            int(random_bits(seed, _PAYLOAD_STREAM + message.ident, self.sent * 8 + k))
            for k in range(-(-message.length // 8))
        ]
        data = np.array(words, np.uint64).view(np.uint8)
        self.payload[: len(data)] = data
        enqueue(
            self.network,
            self.node,
            queued,
            message.ident,
            message.length,
            self.payload,
            message.flags,
            message.bits,
        )
        self.sent, self.last_ns = self.sent + 1, queued
        return queued


def simulate_ages(
    network: Network, loop: Loop, *, duration_ns: int, replayed: Frames | None = None
) -> NDArray[np.int64]:
    """Return the sample-to-force age of every applied command, nanoseconds.

    A sensor samples and sends. In every tick the ECU sends a command computed from the newest
    sample it has received. The actuator reads its newest command once a period; the age runs from
    the sample to that instant. ``replayed``: frames sent by a further node.
    """
    home = int(network.nodes["segment"][loop.command_node])
    far = int(network.nodes["segment"][loop.actuator_node])
    sensor = _Sender(network, loop.sensor_node, loop.sensor)
    command = _Sender(network, loop.command_node, loop.command)
    ages: list[int] = []
    newest, waiting, cursor = -1, -1, 0
    sampled: dict[int, int] = {}
    computed: dict[int, int] = {}
    sample, tick, look = loop.sensor.offset_ns, loop.tick_offset_ns, 0
    player, fed = -1 if replayed is None else add_player(network), 0
    while True:
        now = min(sample, tick, look)
        if now > duration_ns:
            return np.array(ages, np.int64)
        if replayed is not None:
            fed = feed(network, replayed, player, fed, now)
        advance(network, now)
        assert logged(network) - cursor <= len(network.log)
        entries, cursor, _ = drain(network, cursor)
        for entry in entries[np.isin(entries["ident"], (loop.sensor.ident, loop.command.ident))]:
            origin = int(entry["t_origin"])
            if _is(entry, loop.sensor, home, loop.command_node):
                newest = max(newest, sampled.get(origin, -1))
            elif _is(entry, loop.command, far, loop.actuator_node):
                waiting = computed.get(origin, waiting)
        if now == look:
            if waiting >= 0:
                ages.append(now - waiting)
                waiting = -1
            look += loop.actuator_ns
        if now == tick:
            if newest >= 0:
                computed[command.send(now)] = newest
            tick += loop.tick_ns
        if now == sample:
            sampled[sensor.send(now)] = now
            sample = loop.sensor.offset_ns + round(sensor.sent * loop.sensor.period_ns)


def _is(entry: np.void, message: BusMessage, segment: int, receiver: int) -> bool:
    same = entry["ident"] == message.ident and entry["segment"] == segment
    taken = took(entry["outcome"], entry["missed"], receiver)
    return bool(same and taken and (entry["flags"] ^ message.flags) & EXTENDED == 0)


def simulate_ages_of_set(
    messages: Sequence[BusMessage],
    sensor: str,
    command: str,
    *,
    tick_ms: float,
    duration_s: float,
    bitrate: int,
    data_bitrate: int = 0,
    seed: int = 0,
    worst_case_lengths: bool = False,
    phases: int = 20,
    recording: Recording | None = None,
) -> NDArray[np.int64]:
    """Return sample-to-force ages over two messages of a set on one bus, nanoseconds.

    The duration is divided into ``phases`` runs, each with a different phase of the tick and, if
    there is a recording, its next section.

    Raises:
        CanrollError: ``sensor`` and ``command`` are not two messages of the set.
    """
    sent = loop_messages(messages, sensor, command, tick_ms=tick_ms)
    if worst_case_lengths:
        sent = [longest(message) for message in sent]
    spec = traffic_spec(sent, bitrate=bitrate, data_bitrate=data_bitrate, seed=seed)
    ours = {m.name: m for m in sent if m.name in {sensor, command}}
    others = tuple(m.source() for m in sent if m.name not in ours)
    return simulate_ages_of_network(
        replace(spec, sources=others),
        ours[sensor],
        ours[command],
        actuator=LISTENER,
        tick_ns=round(tick_ms * 1e6),
        duration_s=duration_s,
        phases=phases,
        recording=recording,
    )


def simulate_ages_of_routes(
    topology: Topology,
    routed: Sequence[RoutedMessage],
    sensor: str,
    command: str,
    *,
    actuator_segment: int,
    duration_s: float,
    seed: int = 0,
    worst_case_lengths: bool = False,
    phases: int = 20,
) -> NDArray[np.int64]:
    """Return sample-to-force ages over two messages of a network, nanoseconds.

    The tick is the period of the command; the actuator is on segment ``actuator_segment``.
    """
    if worst_case_lengths:
        routed = [replace(way, message=longest(way.message)) for way in routed]
    # the first ones of that name: background that a file describes may have the same
    named = {way.message.name: way for way in reversed(routed)}
    ours = named[sensor], named[command]
    spec = network_spec(topology, routed, nodes=listeners(topology), seed=seed)
    others = tuple(way.message.source() for way in routed if way not in ours)
    return simulate_ages_of_network(
        replace(spec, sources=others),
        *(way.message for way in ours),
        actuator=f"{LISTENER}{actuator_segment}",
        tick_ns=round(ours[1].message.period_ns),
        duration_s=duration_s,
        phases=phases,
    )


def simulate_ages_of_network(
    spec: NetworkSpec,
    sensor: BusMessage,
    command: BusMessage,
    *,
    actuator: str,
    tick_ns: int,
    duration_s: float,
    phases: int = 20,
    recording: Recording | None = None,
) -> NDArray[np.int64]:
    """Return sample-to-force ages over two messages of a network, nanoseconds.

    Args:
        spec: the network, with the other messages as sources.
        sensor: carries the samples.
        command: computed from them, sent in every tick.
        actuator: node that receives the command.
        tick_ns: period of the control loop.
        duration_s: simulated time, divided into ``phases`` runs, each with a different phase of
            the tick and, if there is a recording, its next section.
        phases: number of runs.
        recording: sent by a further node on the first segment.
    """
    nodes = [node.name for node in spec.nodes]
    duration = round(duration_s * 1e9 / phases)
    ages = []
    for phase in range(phases):
        network = build_network(replace(spec, seed=spec.seed + phase))
        loop = Loop(
            sensor=sensor,
            command=command,
            sensor_node=nodes.index(sensor.sender),
            command_node=nodes.index(command.sender),
            actuator_node=nodes.index(actuator),
            tick_ns=tick_ns,
            tick_offset_ns=tick_ns * phase // phases,
        )
        replayed = None
        if recording is not None:
            replayed = recording.frames.piece(phase * duration, (phase + 1) * duration)
        ages.append(simulate_ages(network, loop, duration_ns=duration, replayed=replayed))
    return np.concatenate(ages)
