"""Networks of bus profiles: the roll-control ECU and the vehicle's nodes."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from plant_sim.buses.profile import BusProfile
from plant_sim.can_bus.kernel.layout import Network
from plant_sim.can_bus.kernel.network import (
    MAX_CAPACITY,
    Fault,
    Gateway,
    NetworkSpec,
    Node,
    Segment,
    add_node,
    build_network,
)
from plant_sim.can_bus.own_frames import DEFAULT_COMMAND, MS, messages_of, own_messages
from plant_sim.can_bus.recorded_profile import RecordedProfile
from plant_sim.can_bus.traffic.background import background_messages
from plant_sim.can_bus.traffic.files import load_traffic
from plant_sim.can_bus.traffic.looped import LoopedTraffic
from plant_sim.can_bus.traffic.messages import BusMessage

NODES: Final = ("RollControl", "Imu", "Chassis", "Suspension", "Actuator", "Reference")
"""Nodes of the bus contract, in the order of their numbers on every profile."""
ECU, IMU, CHASSIS, SUSPENSION, ACTUATOR, REFERENCE = range(6)


def segment_of(profile: BusProfile, node: str) -> int:
    """Return the segment that a node of the bus contract sits on."""
    return 0 if node == "RollControl" or profile.segments == 1 else 1


def crosses(profile: BusProfile, message: BusMessage) -> bool:
    """Return whether a receiver of ``message`` sits on the other side of the gateway."""
    home = segment_of(profile, message.sender)
    receivers = [r for r in message.receivers if r in NODES]
    return any(segment_of(profile, receiver) != home for receiver in receivers)


def own_on_segment(
    profile: BusProfile, segment: int, command: str = DEFAULT_COMMAND
) -> list[BusMessage]:
    """Return the own messages on a segment, those that a gateway brings there too."""
    return [
        m
        for m in own_messages(command, profile)
        if segment_of(profile, m.sender) == segment or crosses(profile, m)
    ]


def background_of(
    profile: BusProfile, segment: int, *, command: str = DEFAULT_COMMAND, seed: int = 0
) -> list[BusMessage]:
    """Return the background traffic of a segment of a profile.

    Raises:
        CanrollError: a recorded bus has an own message's identifier on it already.
    """
    if isinstance(profile, RecordedProfile):
        return list(profile.background(own_messages(command, profile)))
    if profile.traffic is not None:
        return _other_traffic(profile.traffic, segment, messages_of(profile))
    return background_messages(
        own_on_segment(profile, segment, command),
        node=_background(segment),
        bitrate=profile.bitrate,
        load=profile.load,
        above=profile.above,
        seed=seed * 2 + segment,
        data_bitrate=profile.data_bitrate,
    )


def _other_traffic(path: Path, segment: int, own: Sequence[BusMessage]) -> list[BusMessage]:
    """The messages of a traffic set that are not our own, which share the bus with all nodes."""
    taken = {message.arbitration_key for message in own}
    return [
        replace(message, sender=_background(segment))
        for message in load_traffic(path).messages
        if message.arbitration_key not in taken
    ]


def _background(segment: int) -> str:
    """The node of a segment that sends its background traffic."""
    return "Background" if segment == 0 else f"Background{segment + 1}"


def profile_spec(
    profile: BusProfile,
    *,
    seed: int = 0,
    command: str = DEFAULT_COMMAND,
    background: bool = True,
    faults: Sequence[Fault] = (),
    bit_error_rate: float | None = None,
    policy: str = "replace",
    log_capacity: int = 1 << 14,
) -> NetworkSpec:
    """Return the description of a bus profile's network; its nodes 0 to 5 are ``NODES``.

    Args:
        profile: of ``plant_sim.buses.load_profile``.
        seed: seeds background payloads and offsets, gateway latencies and bit errors.
        command: the actuator command message in use.
        background: False leaves the bus to the own messages. The frames of a recorded bus are no
            periodic sources: :func:`recorded_traffic` sends them.
        faults: scripted faults.
        bit_error_rate: probability that a bit on the wire is disturbed; None: the profile's.
        policy: transmit queues of the own nodes: ``replace``, ``priority`` or ``fifo``.
        log_capacity: entries in the ring log; a consumer drains at least that often.
    """
    if bit_error_rate is None:
        bit_error_rate = profile.bit_error_rate
    nodes = [Node(name, segment_of(profile, name), policy) for name in NODES]
    own = own_messages(command, profile)
    sources = []
    gateways: tuple[Gateway, ...] = ()
    for segment in range(profile.segments):
        nodes.append(Node(_background(segment), segment, "replace"))
        traffic = background_of(profile, segment, command=command, seed=seed)
        if background and not isinstance(profile, RecordedProfile):
            sources += [message.source() for message in traffic]
    if profile.gateway_ms is not None:
        nodes += [Node("Gateway", 0, "priority"), Node("Gateway2", 1, "priority")]
        low, high = (int(latency * MS) for latency in profile.gateway_ms)
        crossing = [m for m in own if crosses(profile, m)]
        gateways = tuple(
            Gateway(
                *ports,
                low,
                high,
                "fixed" if low == high else "uniform",
                idents=tuple(
                    (m.ident, m.flags) for m in crossing if segment_of(profile, m.sender) == segment
                ),
            )
            for segment, ports in enumerate((("Gateway", "Gateway2"), ("Gateway2", "Gateway")))
        )
    return NetworkSpec(
        segments=(Segment(profile.bitrate, profile.data_bitrate, bit_error_rate=bit_error_rate),)
        * profile.segments,
        nodes=tuple(nodes),
        sources=tuple(sources),
        gateways=gateways,
        faults=tuple(faults),
        seed=seed,
        log_capacity=log_capacity,
    )


def make_network(profile: BusProfile, **options: Any) -> Network:  # noqa: ANN401
    """Return the network of a bus profile at time 0; options as of ``profile_spec``."""
    return build_network(profile_spec(profile, **options))


def recorded_traffic(
    network: Network, profile: BusProfile, *, command: str, seed: int
) -> LoopedTraffic | None:
    """Return what sends the recorded frames of a profile on its network; None: it has none."""
    if not isinstance(profile, RecordedProfile):
        return None
    node = add_node(network, Node("Recording", policy="priority", capacity=MAX_CAPACITY))
    return LoopedTraffic(network, node, profile.loop(own_messages(command, profile)), seed=seed)
