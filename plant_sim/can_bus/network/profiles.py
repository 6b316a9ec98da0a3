"""Networks of bus profiles: the roll-control ECU and the vehicle's nodes."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeGuard

from canroll.plant_sim.buses.profile import BusProfile
from canroll.plant_sim.buses.topology import NODES, PUNCTUAL
from canroll.plant_sim.can_bus.kernel.layout import Network
from canroll.plant_sim.can_bus.kernel.network import (
    MAX_CAPACITY,
    BusFault,
    NetworkSpec,
    Node,
    add_node,
    build_network,
)
from canroll.plant_sim.can_bus.network.network_spec import network_spec
from canroll.plant_sim.can_bus.network.own_frames import (
    DEFAULT_COMMAND,
    frame_names,
    measurement_messages,
    messages_of,
    own_messages,
)
from canroll.plant_sim.can_bus.network.routing import RoutedMessage, RoutedNetwork, route
from canroll.plant_sim.can_bus.traffic.background import background_messages
from canroll.plant_sim.can_bus.traffic.files import load_traffic
from canroll.plant_sim.can_bus.traffic.messages import BusMessage

if TYPE_CHECKING:
    from canroll.plant_sim.can_bus.network.recorded_profile import RecordedProfile
    from canroll.plant_sim.can_bus.traffic.looped import LoopedTraffic

ECU, IMU, CHASSIS, SUSPENSION, ACTUATOR, REFERENCE = range(len(NODES))
"""Numbers of ``NODES`` on every network."""


def routed_messages(
    profile: BusProfile, *, command: str = DEFAULT_COMMAND, seed: int = 0
) -> tuple[RoutedMessage, ...]:
    """Return all messages of a profile's network with their ways: ours, then the background.

    A background message's sender is a node of :func:`profile_spec`.

    Args:
        profile: of ``load_profile``.
        command: the actuator command message in use.
        seed: of the offsets of the background.

    Raises:
        CanrollError: a message does not get to its receivers, or an identifier is there twice; a
            invalid load.
    """
    topology = profile.network
    own = own_messages(command, profile)
    given = [_of_file(profile, segment, own) for segment in range(len(topology.segments))]
    routed = list(route(topology, own, given, frame_names(profile), known=messages_of(profile)))
    filled = () if _is_recorded(profile) else enumerate(topology.segments)
    for number, segment in filled:
        if segment.traffic is None:
            filling = background_messages(
                [r.message for r in routed if number in r.segments],
                node=_background(number),
                bitrate=segment.bitrate,
                load=segment.load,
                above=segment.above,
                seed=seed * max(2, len(topology.segments)) + number,
                data_bitrate=segment.data_bitrate,
            )
            routed += [RoutedMessage(message, number) for message in filling]
    home = topology.place("RollControl")
    taken = {r.message.ident for r in routed if home in r.segments}
    routed += [RoutedMessage(m, home) for m in measurement_messages(profile, taken)]
    return tuple(routed)


def _of_file(profile: BusProfile, segment: int, own: Sequence[BusMessage]) -> list[BusMessage]:
    """The background of a segment that a file describes, without what is ours in it."""
    if _is_recorded(profile):
        return list(profile.background(own))
    place = profile.network.segments[segment]
    if place.traffic is None:
        return []
    names = frame_names(profile)
    ours = {(m.arbitration_key, names[m.name]) for m in messages_of(profile)}
    return [
        replace(message, sender=f"{place.name}/{message.sender}")
        for message in load_traffic(place.traffic).messages
        if (message.arbitration_key, message.name) not in ours
    ]


def _is_recorded(profile: BusProfile) -> "TypeGuard[RecordedProfile]":
    """Whether a profile is that of a log; what reads logs is imported only for one."""
    return profile.recorded


def _background(segment: int) -> str:
    """The node of a segment that sends what fills it up to its load."""
    return "Background" if segment == 0 else f"Background{segment + 1}"


def profile_spec(
    profile: BusProfile,
    *,
    seed: int = 0,
    command: str = DEFAULT_COMMAND,
    background: bool = True,
    faults: Sequence[BusFault] = (),
    bit_error_rate: float | None = None,
    policy: str = "replace",
    log_capacity: int = 1 << 14,
) -> NetworkSpec:
    """Return the description of a bus profile's network; its nodes 0 to 5 are ``NODES``.

    Args:
        profile: of ``canroll.plant_sim.buses.load_profile``.
        seed: seeds background payloads and offsets, gateway latencies and bit errors.
        command: the actuator command message in use.
        background: False leaves the bus to the own messages. The frames of a recorded bus are no
            periodic sources: :func:`recorded_traffic` sends them.
        faults: scripted faults.
        bit_error_rate: probability that a bit on the wire is disturbed; None: the profile's.
        policy: transmit queues of the own nodes: ``replace``, ``priority`` or ``fifo``.
        log_capacity: entries in the ring log; a consumer drains at least that often.
    """
    topology = profile.network
    if bit_error_rate is not None:
        segments = (replace(s, bit_error_rate=bit_error_rate) for s in topology.segments)
        topology = replace(topology, segments=tuple(segments))
    routed = routed_messages(profile, command=command, seed=seed)
    periodic = background and not _is_recorded(profile)
    nodes = [
        Node(name, topology.place(name), policy, jitter=topology.jitter.get(name, PUNCTUAL))
        for name in NODES
    ]
    nodes += [Node(_background(number), number) for number in range(len(topology.segments))]
    spec = network_spec(
        RoutedNetwork(topology, routed),
        nodes=nodes,
        sources=routed[len(own_messages(command, profile)) :] if periodic else (),
        seed=seed,
    )
    return replace(spec, faults=tuple(faults), log_capacity=log_capacity)


def make_network(profile: BusProfile, **options: Any) -> Network:  # noqa: ANN401
    """Return the network of a bus profile at time 0; options as of ``profile_spec``."""
    return build_network(profile_spec(profile, **options))


def recorded_traffic(
    network: Network, profile: BusProfile, *, command: str, seed: int
) -> "LoopedTraffic | None":
    """Return what sends the recorded frames of a profile on its network; None: it has none."""
    if not _is_recorded(profile):
        return None
    node = add_node(network, Node("Recording", policy="priority", capacity=MAX_CAPACITY))
    return profile.sent_by(network, node, own_messages(command, profile), seed=seed)
