"""Profiles carry the load they are named for; simulated ages keep to the delay bounds."""

from dataclasses import replace

import numpy as np
import pytest

from canroll import dbc
from canroll.errors import CanrollError, UnknownNameError, VerdictError
from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.can_bus import (
    ACTUATOR,
    ECU,
    IMU,
    NODES,
    BusProfile,
    account,
    advance,
    drain,
    enqueue,
    load,
    load_profile,
    make_network,
)
from canroll.plant_sim.can_bus.bounds.analysis import response_bounds
from canroll.plant_sim.can_bus.bounds.delay_bounds import (
    Path,
    delay_bounds,
    message_paths,
    total_delay,
)
from canroll.plant_sim.can_bus.network.own_frames import own_messages
from canroll.plant_sim.can_bus.simulation.ages import BusLoop, simulate_ages
from canroll.plant_sim.kernels.instants import MS
from tests.support.background import background_of

FRAMES = {m.name: m.frame_id for m in dbc.load().messages}
OWN = {m.name: m for m in own_messages()}


def run_own_messages(network, profile, *, seconds, seed=0):
    """Send every own message at its cycle time with random payload and offset."""
    rng = np.random.default_rng(seed)
    cursor, logs = 0, []
    releases = []
    for message in own_messages():
        node = NODES.index(message.sender)
        offset = int(rng.integers(message.period_ns))
        for t in range(offset, seconds * 10**9, int(message.period_ns)):
            releases.append((t, node, message.ident))
    step = 100 * MS
    releases.sort()
    place = 0
    for until in range(step, seconds * 10**9 + step, step):
        while place < len(releases) and releases[place][0] <= until:
            t, node, ident = releases[place]
            payload = rng.integers(256, size=8).astype(np.uint8)
            enqueue(network, node, t, ident, 8, payload)
            place += 1
        advance(network, until)
        entries, cursor, missed = drain(network, cursor)
        assert missed == 0
        logs.append(entries)
    return np.concatenate(logs)


@pytest.mark.parametrize("name", [n for n in sorted(BUSES) if load_profile(n).dbc is None])
def test_profiles_have_the_load_they_are_named_for(name):
    profile = load_profile(name)
    network = make_network(profile, seed=2)
    log = run_own_messages(network, profile, seconds=10)
    for segment in range(profile.segments):
        assert load(network, segment) == pytest.approx(profile.load, abs=0.01)
        assert account(network, segment).balanced
    own = {m.ident for m in own_messages()}
    background = log[(log["sender"] >= len(NODES)) & ~np.isin(log["ident"], sorted(own))]
    above = background["ident"] < min(own)
    busy = (background["t_end"] - background["t_start"]).astype(float)
    assert busy[above].sum() / busy.sum() == pytest.approx(profile.above, abs=0.02)
    assert not np.isin(background["ident"], sorted(own)).any()


def test_the_gateway_profile_shows_its_fifty_milliseconds():
    profile = load_profile("gateway_50ms")
    network = make_network(profile, seed=2)
    log = run_own_messages(network, profile, seconds=2)
    imu = log[(log["ident"] == FRAMES["Imu"]) & (log["outcome"] == 0)]
    assert set(imu["segment"]) == {0, 1}
    there = imu[imu["segment"] == 0]
    total = there["t_received"] - there["t_origin"]
    assert total.min() > 50 * MS
    assert total.max() < 54 * MS
    # what concerns nobody on the other side stays where it is
    status = log[log["ident"] == FRAMES["RollControlStatus"]]
    assert set(status["segment"]) == {0}


def loop_of(*, tick_ms, offset_ns):
    return BusLoop(
        sensor=OWN["Imu"],
        command=OWN["SuspensionForceCommand"],
        sensor_node=IMU,
        command_node=ECU,
        actuator_node=ACTUATOR,
        tick_ns=round(tick_ms * MS),
        tick_offset_ns=offset_ns,
    )


@pytest.mark.parametrize("name", sorted(BUSES))
@pytest.mark.parametrize("tick_ms", [5.0, 10.0, 20.0])
def test_simulated_ages_lie_within_the_bounds(name, tick_ms):
    profile = load_profile(name)
    bounds = delay_bounds(profile, tick_ms=tick_ms)
    worst, best = 0, 2**62
    for k in range(6):
        network = make_network(profile, seed=k)
        offset = k * round(tick_ms * MS) // 6 + 137
        ages = simulate_ages(network, loop_of(tick_ms=tick_ms, offset_ns=offset), duration_ns=10**9)
        assert len(ages) > 30
        worst, best = max(worst, int(ages.max())), min(best, int(ages.min()))
    assert worst * 1e-9 <= bounds.age_max
    assert best * 1e-9 >= bounds.age_min
    # no empty promise: the simulation comes near it
    assert worst * 1e-9 > 0.5 * bounds.age_max


@pytest.mark.parametrize("tick_ms", [3.0007, 10.0007, 23.0007, 47.0003])
def test_the_newest_sample_is_older_than_its_response_by_a_sensor_period_at_most(tick_ms):
    """Each frame alone on the bus; tick, sensor and actuator drift through all their phases."""
    response = (111 - 4) * 2000
    loop = replace(
        loop_of(tick_ms=tick_ms, offset_ns=0),
        sensor=replace(OWN["Imu"], bits=111),
        command=replace(OWN["SuspensionForceCommand"], bits=111),
        actuator_ns=999_983,
    )
    path = Path(response * 1e-9, response * 1e-9)
    bound = total_delay(
        path, path, sensor_period_s=0.01, tick_s=tick_ms * 1e-3, actuator_period_s=999_983e-9
    )
    network = make_network(load_profile("500k"), background=False)
    ages = simulate_ages(network, loop, duration_ns=20 * 10**9) * 1e-9
    # where both frames meet, the command waits for the other and its interframe space
    assert bound.age_max - 0.5e-3 < ages.max() <= bound.age_max + 111 * 2e-6


def test_the_least_age_is_that_of_the_shortest_frames_each_used_when_received():
    """Once the bound counted the interframe spaces, which a receiver does not wait for."""
    network = make_network(load_profile("500k"), background=False)
    received = (111 - 4) * 2000
    loop = BusLoop(
        sensor=replace(OWN["Imu"], bits=111),
        command=replace(OWN["SuspensionForceCommand"], bits=111),
        sensor_node=IMU,
        command_node=ECU,
        actuator_node=ACTUATOR,
        tick_ns=10 * MS,
        tick_offset_ns=received,
        # the command starts behind the interframe space of the sensor's frame
        actuator_ns=received + 4 * 2000 + received,
    )
    ages = simulate_ages(network, loop, duration_ns=1 * MS)
    assert list(ages) == [436_000]
    assert delay_bounds(load_profile("500k")).age_min <= 436e-6


def test_bounds_add_up_and_are_monotonous():
    profile = load_profile("500k")
    plain = delay_bounds(profile)
    assert plain.tau_max == pytest.approx(plain.age_max + 0.010)
    assert plain.age_max == pytest.approx(
        plain.sensor.greatest + 0.010 + plain.command.greatest + 0.001
    )
    assert delay_bounds(profile, n_lost=2).tau_max == pytest.approx(plain.tau_max + 0.020)
    assert delay_bounds(profile, filter_delay_s=0.003).tau_min == pytest.approx(
        plain.tau_min + 0.003
    )
    assert (
        delay_bounds(profile, run_time_s=0.0005, jitter_s=0.0005).tau_max >= plain.tau_max + 0.001
    )
    assert plain.tau_min < plain.tau_max


def test_without_a_gateway_the_paths_are_plain_response_times():
    profile = load_profile("125k_busy")
    messages = [*background_of(profile, 0), *own_messages()]
    bounds = {b.message.name: b.bound_ns for b in response_bounds(messages, bitrate=125_000)}
    paths = message_paths(profile, command_period_ms=50.0)
    assert paths["Imu"].greatest == pytest.approx(bounds["Imu"] * 1e-9)


def test_user_errors_say_what_is_wrong():
    with pytest.raises(UnknownNameError, match="did you mean '500k'"):
        load_profile("500")
    with pytest.raises(VerdictError, match="is unbounded"):
        delay_bounds(load_profile("125k_busy"), tick_ms=1.0)
    with pytest.raises(CanrollError, match="tick"):
        delay_bounds(load_profile("500k"), tick_ms=0.0)
    with pytest.raises(CanrollError, match="not a message"):
        delay_bounds(load_profile("500k"), sensor="Gyro")
    with pytest.raises(CanrollError, match="above the requested load"):
        make_network(BusProfile("small", 125_000, 0.3))
    with pytest.raises(UnknownNameError, match="command message"):
        make_network(load_profile("500k"), command="ForceCommand")
