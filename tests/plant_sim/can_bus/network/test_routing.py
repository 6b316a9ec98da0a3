"""The ways of messages over gateways, and their bounds: no simulated frame arrives later."""

from dataclasses import replace

import pytest

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.buses.topology import BusGateway, BusSegment, TimeSpread, Topology
from canroll.plant_sim.can_bus import (
    BusProfile,
    load_profile,
    profile_spec,
)
from canroll.plant_sim.can_bus.bounds.holistic import arrivals
from canroll.plant_sim.can_bus.network.own_frames import own_messages
from canroll.plant_sim.can_bus.network.profiles import routed_messages
from canroll.plant_sim.can_bus.network.routing import Hop, RoutedMessage, RoutedNetwork, route
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.kernels.instants import MS

LINE = Topology(
    segments=(
        BusSegment("ecu", 500_000, 0.4),
        BusSegment("backbone", 1_000_000, 0.3),
        BusSegment("vehicle", 250_000, 0.6),
    ),
    gateways=(
        BusGateway("central", (1, 0), TimeSpread(1 * MS, 2 * MS)),
        BusGateway("zone", (1, 2), TimeSpread(2 * MS, 2 * MS)),
    ),
    places={"RollControl": 0, "Reference": 1}
    | dict.fromkeys(("Imu", "Chassis", "Suspension", "Actuator"), 2),
)


def message(name, ident, *, sender="n", receivers=(), period_ms=10, **options):
    return BusMessage(name, ident, 8, period_ms * MS, sender, tuple(receivers), **options)


def profile(topology):
    near = topology.segments[0]
    return BusProfile("net", near.bitrate, near.load, topology=topology)


def test_our_messages_go_to_their_receivers_and_no_farther():
    ways = {r.message.name: r for r in routed_messages(profile(LINE))}
    assert ways["Imu"].segments == (2, 1, 0)
    assert ways["Imu"].way_to(0) == (Hop(1, 2, 1), Hop(0, 1, 0))
    assert ways["RollReference"].segments == (1, 0)
    assert ways["SuspensionForceCommand"].segments == (0, 1, 2)
    assert ways["RollControlStatus"].segments == (0,)


def test_of_two_ways_one_is_taken():
    ring = replace(LINE, gateways=(*LINE.gateways, BusGateway("short", (0, 2), TimeSpread(MS, MS))))
    ways = {r.message.name: r for r in routed_messages(profile(ring))}
    assert ways["Imu"].hops == (Hop(2, 2, 0),)


def test_a_list_passes_on_what_is_in_it_from_either_side():
    first, second = message("A", 0x100), message("B", 0x101)
    gateway = BusGateway("g", (0, 1), TimeSpread(0, 0), ("A", 0x101))
    topology = Topology((BusSegment("x", 500_000), BusSegment("y", 500_000)), (gateway,))
    ways = route(topology, (), [[first, message("C", 0x102)], [second]], {})
    assert [way.segments for way in ways] == [(0, 1), (0,), (1, 0)]
    assert route(topology, (first, second), [[], []], {"B": "Frame"})[1].segments == (0, 1)


def listed(*gateways):
    places = {"RollControl": 0, "Imu": 1}
    return Topology(
        tuple(BusSegment(name, 500_000) for name in "xyz"),
        tuple(BusGateway(f"g{k}", g[0], TimeSpread(), g[1]) for k, g in enumerate(gateways)),
        places,
    )


IMU = message("Imu", 0xA0, sender="Imu", receivers=["RollControl"])
OTHER = message("Engine", 0xA0)


@pytest.mark.parametrize(
    ("topology", "background", "word"),
    [
        (listed(((0, 1), ("Yaw",))), [message("Yaw", 1)], "Imu does not get from segment 'y' to"),
        (listed(), [], "no gateway passes it on"),
        (listed(((0, 1), ("Imus",))), [], "did you mean 'Imu'"),
        (listed(((0, 1), (0xB0,))), [], "no message of the network has identifier 0xB0"),
        (
            listed(((0, 1), ("Imu",)), ((1, 2), ("Imu",)), ((2, 0), ("Imu",))),
            [],
            "gateway 'g2': Imu returns by it",
        ),
        (listed(((0, 1), ("Imu",))), [OTHER], "segment 'x': Imu and Engine both have"),
        (listed(((1, 0), None)), [OTHER], "segment 'x': Imu and Engine both have"),
    ],
)
def test_what_cannot_be_is_refused(topology, background, word):
    with pytest.raises((CanrollError, UnknownNameError), match=word) as caught:
        route(topology, (IMU,), [background, [], []], {})
    assert "\n" not in str(caught.value)


def test_a_gateway_of_no_latency_is_no_more_than_two_buses():
    ways = route(
        Topology(
            (BusSegment("x", 500_000), BusSegment("y", 500_000)),
            (BusGateway("g", (0, 1), TimeSpread()),),
            {"Imu": 0, "RollControl": 1},
        ),
        (IMU,),
        [[], []],
        {},
    )
    topology = Topology((BusSegment("x", 500_000),) * 2, (BusGateway("g", (0, 1), TimeSpread()),))
    (found,) = arrivals(RoutedNetwork(topology, ways))
    frame = IMU.worst_ns(500_000)
    shortest = IMU.best_ns(500_000)
    # alone on both: its longest frame twice
    assert found[0].greatest_ns == frame
    assert found[1].greatest_ns == 2 * frame
    assert found[1].least_ns == 2 * shortest - 2 * 4 * 2000


def test_the_built_in_gateways_are_as_before():
    spec = profile_spec(load_profile("gateway_20ms"), seed=4)
    assert [g.latency for g in spec.gateways] == [TimeSpread(5 * MS, 10 * MS)] * 2
    there = {m.name: m.ident for m in own_messages()}
    assert (there["Imu"], 0) in spec.gateways[1].idents
    assert (there["SuspensionForceCommand"], 0) in spec.gateways[0].idents
    assert isinstance(routed_messages(load_profile("500k"))[0], RoutedMessage)
