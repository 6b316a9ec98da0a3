"""Simulated ages: from a sensor's sample to the instant the resulting command is applied."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.can_bus.kernel.layout import LOGGED, MAX_PAYLOAD, SEED, Network
from canroll.plant_sim.can_bus.kernel.ledger import took
from canroll.plant_sim.can_bus.kernel.network import build_network
from canroll.plant_sim.can_bus.kernel.queues import enqueue
from canroll.plant_sim.can_bus.kernel.scheduler import advance
from canroll.plant_sim.can_bus.network.network_spec import network_spec
from canroll.plant_sim.can_bus.network.routing import RoutedNetwork
from canroll.plant_sim.can_bus.simulation.response_times import add_player, listeners, with_longest
from canroll.plant_sim.can_bus.traffic.log_playback import RecordedFrames, Recording, feed
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import EXTENDED
from canroll.plant_sim.kernels.random import Stream, random_bits, uniform


@dataclass(frozen=True, slots=True)
class BusLoop:
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
        draw = float(uniform(seed, Stream.AGE_JITTER + message.ident, self.sent))
        queued = max(nominal_ns + int(draw * (message.jitter_ns + 1)), self.last_ns + 1)
        words = [
            int(random_bits(seed, Stream.AGE_PAYLOAD + message.ident, self.sent * 8 + k))
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
    network: Network, loop: BusLoop, *, duration_ns: int, replayed: RecordedFrames | None = None
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
    clock, log, idents = network.clock, network.log, network.log["ident"]
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
        first, cursor = cursor, int(clock[LOGGED])
        assert cursor - first <= len(log)
        # one by one in place: an operation on an array takes longer than the few since the last
        for place in (number % len(log) for number in range(first, cursor)):
            if idents[place] not in (loop.sensor.ident, loop.command.ident):
                continue
            entry = log[place]
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


def simulate_ages_of_network(
    network: RoutedNetwork,
    sensor: str,
    command: str,
    *,
    actuator_segment: int,
    duration_s: float,
    seed: int = 0,
    worst_case_lengths: bool = False,
    phases: int = 20,
    recording: Recording | None = None,
) -> NDArray[np.int64]:
    """Return sample-to-force ages over two messages of a network, nanoseconds.

    Args:
        network: the tick is the period of the command, see ``RoutedNetwork.in_every_tick``.
        sensor: name of the message with the samples.
        command: name of the message computed from them.
        actuator_segment: number of the actuator's segment.
        duration_s: simulated time, divided into ``phases`` runs, each with a different phase of
            the tick and, if there is a recording, its next section.
        seed: of payloads, jitter and latencies.
        worst_case_lengths: send classic frames with the maximum number of stuff bits.
        phases: number of runs.
        recording: sent by a further node on the first segment.

    Raises:
        CanrollError: ``sensor`` and ``command`` are not two messages of the network.
    """
    if worst_case_lengths:
        network = with_longest(network)
    ours = network.pair(sensor, command)
    spec = network_spec(network, nodes=listeners(network.topology))
    others = tuple(r.message.source() for r in network.messages if r not in ours)
    nodes = [node.name for node in spec.nodes]
    samples, commands = (r.message for r in ours)
    tick_ns, duration = round(commands.period_ns), round(duration_s * 1e9 / phases)
    ages = []
    for phase in range(phases):
        simulated = build_network(replace(spec, sources=others, seed=seed + phase))
        loop = BusLoop(
            samples,
            commands,
            nodes.index(samples.sender),
            nodes.index(commands.sender),
            actuator_node=actuator_segment,  # the listeners are the first nodes
            tick_ns=tick_ns,
            tick_offset_ns=tick_ns * phase // phases,
        )
        replayed = None
        if recording is not None:
            replayed = recording.frames.piece(phase * duration, (phase + 1) * duration)
        ages.append(simulate_ages(simulated, loop, duration_ns=duration, replayed=replayed))
    return np.concatenate(ages)
