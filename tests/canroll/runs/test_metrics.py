import math

import numpy as np
import pytest

from canroll import vehicles
from canroll.runs import metrics

ROOT_HALF = math.sqrt(0.5)


def test_roll_and_moment_of_a_sine(make_trace):
    figures = metrics.judge(make_trace(amplitude=0.05, moment=800.0))
    assert figures.roll_max_deg == pytest.approx(math.degrees(0.05), rel=1e-6)
    assert figures.roll_rms_deg == pytest.approx(math.degrees(0.05) * ROOT_HALF, rel=1e-3)
    assert figures.roll_rate_max_deg_s == pytest.approx(math.degrees(0.05 * math.pi), rel=1e-6)
    assert figures.moment_max_nm == pytest.approx(800)
    assert figures.moment_rms_nm == pytest.approx(800 * ROOT_HALF, rel=1e-3)
    assert figures.nlt_front_max == pytest.approx(3000 / 12000)
    assert not figures.rollover


def test_load_transfer_of_an_axle_in_the_air_is_zero():
    nothing = np.zeros(3)
    assert np.all(metrics.load_transfer(nothing, nothing) == 0)
    assert metrics.load_transfer(np.zeros(1), np.full(1, 5e3))[0] == 1


def test_left_turn_loads_the_right_wheels(make_trace):
    trace = make_trace()
    turn = trace.signals["ay"] > 1
    for axle in ("front", "rear"):
        loads = (trace.signals[name][turn] for name in metrics.loads_of(axle))
        assert np.all(metrics.load_transfer(*loads) > 0)


def test_load_transfer_without_roll_meets_a_plant_held_upright(make_trace):
    """The made-up car does not roll and holds m h a_y with the shares asked for: no change."""
    van = vehicles.load("van_real")
    trace = make_trace(amplitude=0.0)
    held = van.plant.roll_arm * trace.signals["ay"]
    for axle, share in (("front", 0.6), ("rear", 0.4)):
        track = getattr(van.geometry, f"half_track_{axle}")
        for side, sign in (("left", -1), ("right", 1)):
            load = 6000.0 + sign * share * held / track / 2
            trace.signals[f"wheel_load_{axle}_{side}"] = load
    figures = metrics.load_transfer_without_roll(trace, van, 0.6)
    # nothing was carried by springs, so the whole of the held moment comes on top
    peak = 0.6 * van.plant.roll_arm * 4 / van.geometry.half_track_front / 12000
    assert figures["nlt_front_max"] == pytest.approx(2 * peak)
    assert figures["nlt_rear_max"] > 0


def test_load_transfer_without_roll_falls_by_the_leaning_of_the_body(make_trace):
    """Steady cornering with equal shares: what m g h φ moved is what goes."""
    van = vehicles.load("van_real")
    share = van.suspension.roll_stiffness_front_share
    trace = make_trace()
    roll = np.full_like(trace.signals["roll"], 0.05)
    ay = roll * van.plant.effective_stiffness / van.plant.roll_arm
    trace.signals.update(roll=roll, roll_rate=0 * roll, ay=ay)
    moved = share * van.plant.roll_stiffness * roll / van.geometry.half_track_front
    trace.signals["wheel_load_front_left"] = 6000.0 - moved / 2
    trace.signals["wheel_load_front_right"] = 6000.0 + moved / 2
    leaning = share * van.plant.roll_arm * 9.81 * 0.05 / van.geometry.half_track_front
    figures = metrics.load_transfer_without_roll(trace, van, share)
    assert figures["nlt_front_max"] == pytest.approx((moved[0] - leaning) / 12000)


def test_bus_figures(make_trace):
    can = metrics.can(make_trace())
    assert can.load == pytest.approx(2 * 240e-6 / 10e-3)
    assert can.frames == 1600
    assert can.response_ms["Imu"].max == pytest.approx(0.24)
    assert can.response_ms["ActuatorState"].mean == pytest.approx(0.48)
    assert (can.age_ms.min, can.age_ms.max) == (8, 24)


def test_transmission_rate_with_and_without_heartbeats(make_trace):
    trigger = metrics.trigger(make_trace(), heartbeat_ticks=5)
    assert trigger.samples == 751
    assert trigger.sent == 150 + 30 and trigger.heartbeats == 30
    assert trigger.transmission_rate == pytest.approx(180 / 751)
    assert trigger.transmission_rate_triggered == pytest.approx(150 / 751)
    assert trigger.floor == pytest.approx(0.2)


def test_nothing_sent_is_a_rate_of_zero(make_trace):
    assert metrics.trigger(make_trace(commands=False), heartbeat_ticks=5).sent == 0
