"""Sample-to-force ages: never above their bound, over any set of classic, FD, extended frames."""

import pytest

from canroll.plant_sim.can_bus.bounds.delay_bounds import loop_delay
from canroll.plant_sim.can_bus.network.routing import RoutedNetwork
from canroll.plant_sim.can_bus.simulation.ages import simulate_ages_of_network
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD

MS = 1_000_000


def fd_set():
    def message(name, ident, period_ms, length=64):
        return BusMessage(
            name, ident, length, period_ms * MS, name, flags=FD | BIT_RATE_SWITCH | EXTENDED
        )

    return [
        message("Imu", 0x0A0 << 18, 10, 32),
        message("SuspensionForceCommand", 0x080 << 18, 10, 32),
        message("Radar", 0x7000010, 5),
        message("Lidar", 0x1F000010, 5),
    ]


def test_ages_are_simulated_with_the_frames_of_the_set():
    """FD at its own data rate and extended identifiers; once all were 11-bit frames of 8 bytes."""
    names = ("Imu", "SuspensionForceCommand")
    rates = {"bitrate": 500_000, "data_bitrate": 4_000_000}
    network = RoutedNetwork.one_bus(fd_set(), **rates)
    bounds = loop_delay(network, *names)
    ages = simulate_ages_of_network(network, *names, actuator_segment=0, duration_s=4.0)
    assert bounds.age_min <= ages.min() * 1e-9
    assert 0.8 * bounds.age_max < ages.max() * 1e-9 <= bounds.age_max


def test_a_faster_tick_is_in_the_bound():
    """The command is sent in every tick, whatever period the set has for it."""
    found = [
        BusMessage("Imu", 0x300, 8, 10 * MS, "Imu"),
        BusMessage("Command", 0x80, 8, 50 * MS, "Ecu"),
        BusMessage("Other", 0x700, 8, 10 * MS, "Other"),
    ]
    network = RoutedNetwork.one_bus(found, bitrate=125_000)
    slow, fast, none = (
        loop_delay(network.in_every_tick("Command", tick_ms=tick), "Imu", "Command")
        for tick in (10, 1.5, 1.0)
    )
    assert fast.sensor.greatest > slow.sensor.greatest
    assert (none.message.name, none.bound_ns, none.covered) == ("Imu", None, True)


@pytest.mark.parametrize("pair", [("Imu", "Imu"), ("Imu", "Radio"), ("Radio", "Lidar")])
def test_both_messages_have_to_be_there_and_two(pair):
    with pytest.raises(Exception, match="message"):
        loop_delay(RoutedNetwork.one_bus(fd_set(), bitrate=500_000), *pair)
