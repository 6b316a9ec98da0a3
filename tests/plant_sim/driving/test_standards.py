from dataclasses import replace

import numpy as np
import pytest

from canroll import vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.driving import maneuvers, path, standards, steer_maneuvers
from canroll.plant_sim.world import open_loop

VAN = vehicles.load("van_real")
BODY = bodies.body("nonlinear")


def verdicts(name, vehicle=VAN, speed=None, **options):
    maneuver = maneuvers.build(name, vehicle, speed, **options)
    signals = open_loop.signals(*open_loop.run_passive(vehicle, BODY, maneuver))
    return {verdict.criterion: verdict for verdict in standards.judge(name, vehicle, signals)}


def fake(**changed):
    n = 6000
    signals = {name: np.zeros(n) for name in ("x", "y", "yaw", "vx", "yaw_rate", "rollover")}
    signals |= {f"wheel_height_{wheel}": np.zeros(n) for wheel in standards.WHEELS}
    signals["steer"] = np.full(n, 5.0 * steer_maneuvers.reference_angle(VAN))
    return signals | changed


def test_yaw_decay_is_measured_against_the_second_peak():
    time = np.arange(6000) * 1e-3
    end = steer_maneuvers.START + 1 / 0.7 + 0.5
    yaw_rate = np.where(time < 1.0, 0.9, 0.5)  # a larger first peak must not count
    yaw_rate = np.where(time > end + 0.9, 0.15, yaw_rate)
    yaw_rate = np.where(time > end + 1.7, 0.11, yaw_rate)
    first, second, moved = standards.sine_with_dwell(VAN, fake(yaw_rate=yaw_rate))
    assert first.value == pytest.approx(0.30) and first.passed
    assert second.value == pytest.approx(0.22) and not second.passed
    assert moved.value == 0.0 and not moved.passed


def test_displacement_is_judged_from_five_times_the_reference_on():
    gentle = fake(yaw_rate=np.ones(6000), steer=np.full(6000, 1e-3))
    assert len(standards.sine_with_dwell(VAN, gentle)) == 2


def test_chassis_control_is_what_passes_the_sine_with_dwell():
    off, on = (verdicts("sine_with_dwell", chassis_control=x) for x in (False, True))
    assert not all(verdict.passed for verdict in off.values())
    assert all(verdict.passed for verdict in on.values())


def test_two_wheel_lift_needs_both_wheels_of_one_side():
    up = np.zeros(6000)
    up[100:200] = 0.06
    crossed = fake(wheel_height_front_left=up, wheel_height_rear_right=up)
    assert standards.two_wheel_lift(crossed)[0].passed
    sided = fake(wheel_height_front_left=up, wheel_height_rear_left=0.9 * up)
    assert standards.two_wheel_lift(sided)[0].value == pytest.approx(0.054)
    assert not standards.two_wheel_lift(sided)[0].passed
    assert not standards.two_wheel_lift(fake(rollover=up))[0].passed


def test_fishhook_verdicts():
    assert verdicts("fishhook", speed=60 / 3.6)["two-wheel lift"].passed
    assert not verdicts("fishhook", speed=100 / 3.6)["two-wheel lift"].passed


def test_cones_are_hit_by_a_car_that_drives_straight_on():
    lanes = path.double_lane_change(VAN.geometry.width, 3.5)
    straight = fake(x=np.linspace(0.0, 160.0, 6000))
    # The side lane begins left of where the car goes straight on.
    hits = standards.cones(VAN, straight, lanes, "").value
    assert hits == 0
    shifted = fake(x=np.linspace(0.0, 160.0, 6000), y=np.full(6000, 0.5))
    assert standards.cones(VAN, shifted, lanes, "").value > 5


def test_slow_cone_tracks_are_clean_and_fast_ones_are_not():
    assert verdicts("double_lane_change", speed=60 / 3.6)["cones hit"].passed
    assert not verdicts("double_lane_change", speed=110 / 3.6)["cones hit"].passed
    slow = verdicts("moose", speed=40 / 3.6, friction=1.0, preview_time=0.5)
    assert slow["cones hit"].passed
    assert slow["entry speed"].value == pytest.approx(40.0, abs=0.5)


def test_heavy_vehicles_have_a_shorter_displacement():
    heavy = replace(VAN, mass=replace(VAN.mass, unsprung_front=1100.0))
    steer = np.full(6000, 5.0 * steer_maneuvers.reference_angle(heavy))
    assert standards.sine_with_dwell(heavy, fake(steer=steer))[-1].limit == 1.52


def test_manoeuvres_without_criteria_have_no_verdicts():
    assert verdicts("roundabout") == {}
