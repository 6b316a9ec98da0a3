"""Sample-to-force ages: never above their bound, over any set of classic, FD, extended frames."""

from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from plant_sim.can_bus.bounds.analysis import response_bounds, worst_case_utilisation
from plant_sim.can_bus.bounds.delay_bounds import DelayBounds, loop_delay
from plant_sim.can_bus.network.routing import RoutedNetwork
from plant_sim.can_bus.simulation.ages import simulate_ages_of_network
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD, FD_LENGTHS
from tests.support.simulated_set import simulated_responses

MS = 1_000_000


@st.composite
def messages(draw, place):
    fd, extended = draw(st.booleans()), draw(st.booleans())
    flags = (EXTENDED if extended else 0) | (FD if fd else 0)
    flags |= BIT_RATE_SWITCH if fd and draw(st.booleans()) else 0
    # the lowest bits tell the messages apart, the highest decide
    base = draw(st.integers(0, 2**7 - 1)) << 4 | place
    ident = base << 18 | draw(st.integers(0, 2**18 - 1)) if extended else base
    length = draw(st.sampled_from(FD_LENGTHS)) if fd else draw(st.integers(0, 8))
    period = draw(st.integers(2_000_000, 20_000_000))
    return BusMessage(
        f"m{place}",
        ident,
        length,
        period + draw(st.sampled_from((0, 0.25, 1 / 3))),
        f"n{draw(st.integers(0, place))}",
        jitter_ns=draw(st.one_of(st.just(0), st.integers(0, period // 2))),
        offset_ns=draw(st.integers(0, period)),
        flags=flags,
    )


@st.composite
def sets(draw):
    """Return messages below full load, the bit rates, and a tick in ms."""
    count = draw(st.integers(2, 8))
    found = [draw(messages(place)) for place in range(count)]
    bitrate = draw(st.sampled_from((125_000, 300_000, 500_000, 1_000_000)))
    rates = {"bitrate": bitrate, "data_bitrate": bitrate * draw(st.sampled_from((1, 2, 5, 7)))}
    tick_ms = draw(st.sampled_from((2.0, 5.0, 7.5, 10.0)))
    scale = max(1.0, worst_case_utilisation(found, **rates) / draw(st.floats(0.2, 0.8)))
    found = [replace(m, period_ns=m.period_ns * scale) for m in found]
    return found, rates, tick_ms


@pytest.mark.slow
@given(sets(), st.booleans(), st.integers(0, 100))
def test_no_age_and_no_response_is_above_its_bound(drawn, longest, seed):
    found, rates, tick_ms = drawn
    sensor, command = found[0].name, found[-1].name
    network = RoutedNetwork.one_bus(found, **rates).in_every_tick(command, tick_ms=tick_ms)
    bounds = loop_delay(network, sensor, command)
    assume(isinstance(bounds, DelayBounds))
    ages = simulate_ages_of_network(
        network,
        sensor,
        command,
        actuator_segment=0,
        duration_s=2.0,
        seed=seed,
        worst_case_lengths=longest,
        phases=4,
    )
    assume(len(ages) > 0)
    assert round(bounds.age_min * 1e9) <= ages.min()
    assert ages.max() <= round(bounds.age_max * 1e9)
    simulated = simulated_responses(
        found, duration_s=0.2, seed=seed, worst_case_lengths=longest, **rates
    )
    for bound in response_bounds(found, **rates):
        seen = simulated[bound.message.name]
        assert len(seen) == 0 or bound.bound_ns is None or seen.max() <= bound.bound_ns
        assert len(seen) == 0 or seen.min() >= bound.best_ns


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
