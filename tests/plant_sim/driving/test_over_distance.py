"""Wind, friction, bank and speed over distance, and pedals, against expressions of textbooks."""

from math import hypot, radians

import numpy as np
import pytest

from canroll import vehicles
from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.driving import maneuvers, road
from canroll.plant_sim.world import open_loop
from canroll.vehicles.model import Aerodynamics

NONLINEAR = bodies.body("nonlinear")
VAN, SEDAN = vehicles.load("van_real"), vehicles.load("sedan_320i")
G = vehicles.GRAVITY
SLIDING = np.sin(VAN.tyre.shape * np.pi / 2) * VAN.tyre.friction
"""Friction of a wheel that slides on dry road: the end of the magic formula's curve."""
AIR = {
    "frontal_area": 4.0,
    "side_force_slope": 3.0,
    "centre_of_pressure_ahead": 0.5,
    "centre_of_pressure_height": 1.1,
}


def run(name, vehicle=VAN, speed=None, body=NONLINEAR, **options):
    maneuver = maneuvers.build(name, vehicle, speed, **options)
    return open_loop.run_passive(vehicle, body, maneuver)[0]


def with_air(vehicle):
    table = vehicle.document
    return vehicles.load(
        table | {"aerodynamics": AIR, "sources": table["sources"] | {"aerodynamics": "chosen"}}
    )


def road_of(tmp_path, header, *rows):
    path = tmp_path / "road.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return str(path)


def test_the_side_force_is_that_of_the_coefficient_at_the_angle_of_flow():
    vehicle = with_air(VAN)
    maneuver = maneuvers.build("crosswind", vehicle, 100 / 3.6, crosswind=15.0, length=60.0)
    state, inputs, parameters, outputs = open_loop.start(vehicle, NONLINEAR, maneuver)
    force = 0.0
    for k in range(1500):
        open_loop.apply_drive(k * 1_000_000, outputs, inputs, maneuver.drive)
        if k == 1200:  # the whole car is in the wind
            yaw, vx, vy = outputs[[ports.YAW, ports.VX, ports.VY]]
            along, across = 15.0 * np.sin(yaw) - vx, 15.0 * np.cos(yaw) - vy
            coefficient = 3.0 * across / hypot(along, across)
            force = 0.5 * 1.2 * 4.0 * coefficient * (along**2 + across**2)
            assert inputs[ports.WIND_FORCE] == pytest.approx(force, rel=1e-12)
            ahead = 0.5 + (1.75 - 1.91) / 2
            assert inputs[ports.WIND_YAW] == pytest.approx(ahead * force, rel=1e-12)
            assert inputs[ports.WIND_ROLL] == pytest.approx(-1.1 * force, rel=1e-12)
        open_loop.advance(NONLINEAR.step, state, inputs, parameters, outputs, 1e-3)
    assert force > 1000.0


@pytest.mark.parametrize("vehicle", [VAN, SEDAN], ids=["van", "sedan"])
def test_a_steady_side_force_turns_and_rolls_the_car_as_the_linear_bicycle(vehicle):
    """Yaw rate by the distance of the force from the neutral steer point (Mitschke, Milliken)."""
    speed, force, ahead, height = 100 / 3.6, 200.0, 0.6, 1.0
    state, parameters = NONLINEAR.build(vehicle, speed)
    inputs, outputs = ports.initial_inputs(), np.zeros(ports.N_OUTPUTS)
    weight = vehicle.total_mass * G
    inputs[ports.DRIVE_FORCE] = vehicle.tyre.rolling_resistance * weight
    inputs[ports.WIND_FORCE : ports.WIND_YAW + 1] = force, -height * force, ahead * force
    for _ in range(4000):
        open_loop.advance(NONLINEAR.step, state, inputs, parameters, outputs, 1e-3)
    front, rear = vehicle.tyre.cornering_stiffness_front, vehicle.tyre.cornering_stiffness_rear
    a, b = vehicle.geometry.cg_to_front_axle, vehicle.geometry.cg_to_rear_axle
    neutral = (a * front - b * rear) / (front + rear)
    wheelbase = a + b
    yaw_rate = force * speed * (ahead - neutral) * (front + rear) / (front * rear * wheelbase)
    yaw_rate /= wheelbase + vehicle.understeer * speed**2
    assert outputs[ports.YAW_RATE] == pytest.approx(yaw_rate, rel=0.02)
    plant = vehicle.plant
    moment = plant.roll_arm * speed * yaw_rate - force * (height - vehicle.roll_axis_height)
    # the tyres, which this stiffness contains, carry the wind's moment about the road
    assert outputs[ports.ROLL] == pytest.approx(moment / plant.effective_stiffness, rel=0.1)


def test_a_vehicle_without_aerodynamics_says_what_is_guessed():
    guessed = VAN.side_wind
    assert 3.0 < guessed.frontal_area < 5.5 and 0.8 < guessed.centre_of_pressure_height < 1.5
    assert any("guessed" in remark for remark in maneuvers.build("crosswind", VAN).remarks)
    stated = with_air(VAN)
    assert stated.side_wind == Aerodynamics(**AIR)
    assert vehicles.load(stated.document).aerodynamics == stated.aerodynamics
    assert not maneuvers.build("crosswind", stated).remarks


def test_a_driver_holds_the_lane_in_a_gust_that_a_fixed_wheel_does_not():
    free, driven = (run("crosswind", driver=on) for on in (False, True))
    assert free[-1, ports.Y] > 1.0 and abs(driven[-1, ports.Y]) < 0.1
    other = run("crosswind", crosswind=-20.0)
    np.testing.assert_allclose(other[-1, ports.Y], -free[-1, ports.Y], rtol=1e-9)


def test_brakes_on_split_friction_turn_the_car_to_the_side_with_grip():
    outputs = run("split_friction", deceleration=4.0)
    first = outputs[1000]  # half a second of braking
    assert first[ports.YAW_RATE] > 0.03
    both = 0.5 * (4.0 + 0.3 * G * SLIDING)
    assert -outputs[900:1100, ports.AX].mean() == pytest.approx(both, rel=0.05)
    assert outputs[-1, ports.WHEEL_SPEED + 1] < 2.0 < outputs[1500, ports.WHEEL_SPEED]
    mirrored = run("split_friction", deceleration=4.0, friction_left=0.3, friction_right=1.0)
    np.testing.assert_allclose(mirrored[1000, ports.YAW_RATE], -first[ports.YAW_RATE], rtol=1e-9)
    held = run("split_friction", deceleration=4.0, driver=True, chassis_control=True)
    assert np.abs(held[:, ports.Y]).max() < 0.5


@pytest.mark.parametrize(("friction", "expected"), [(1.0, 5.0), (0.3, 0.3 * G * SLIDING)])
def test_braking_is_what_the_pedal_asks_for_or_the_road_permits(friction, expected):
    outputs = run("friction_jump", friction_after=friction)
    settled = outputs[1000:2500, ports.AX].mean()
    assert -settled == pytest.approx(expected, rel=0.03)
    assert np.abs(outputs[:, ports.YAW_RATE]).max() < 1e-9


def test_brakes_load_the_axles_evenly():
    """By the ideal distribution, every axle has the same share of its grip."""
    maneuver = maneuvers.build("friction_jump", VAN, friction_after=1.0, deceleration=6.0)
    state, inputs, parameters, outputs = open_loop.start(VAN, NONLINEAR, maneuver)
    for k in range(1500):
        open_loop.apply_drive(k * 1_000_000, outputs, inputs, maneuver.drive)
        open_loop.advance(NONLINEAR.step, state, inputs, parameters, outputs, 1e-3)
    used = (
        inputs[ports.BRAKE_FORCE : ports.BRAKE_FORCE + 4]
        / outputs[ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4]
    )
    assert used == pytest.approx(np.full(4, 6.0 / G), rel=0.03)


@pytest.mark.parametrize("acceleration", [-0.7, 1.5])
def test_the_accelerator_of_a_steady_curve_is_released_or_pressed(acceleration):
    outputs = run("power_off_in_curve", acceleration=acceleration)
    before, after = outputs[5400], outputs[7500]
    gained = (after[ports.VX] - before[ports.VX]) / 2.0
    # rolling resistance, and what the tyres' slip costs in the curve
    assert gained == pytest.approx(acceleration - 0.011 * G - 0.2, abs=0.2)
    assert before[ports.VX] ** 2 / before[ports.AY] == pytest.approx(100.0, rel=0.1)


def test_a_road_of_a_file_is_that_of_a_manoeuvre(tmp_path):
    speed = 80 / 3.6
    file = road_of(tmp_path, "distance,bank_deg", "0,0", "10,0", f"{10 + speed},-5", "900,-5")
    own = run("banked_curve", radius=150)
    same = run("constant_radius", radius=150, road=file, speed=speed)
    np.testing.assert_allclose(same[-1, ports.ROLL], own[-1, ports.ROLL], rtol=1e-3)
    assert abs(own[-1, ports.ROLL]) > radians(0.5)


def test_friction_of_a_file_is_met_by_each_wheel_at_its_place(tmp_path):
    file = road_of(
        tmp_path, "distance,friction_left,friction_right", "0,1,1", "20,1,1", "20.1,0.5,0.8"
    )
    maneuver = maneuvers.build("bumps", VAN, 10.0, road=file, friction=0.9)
    _, inputs, _, outputs = open_loop.start(VAN, NONLINEAR, maneuver)
    outputs[ports.VX] = 10.0

    def at(distance):
        maneuver.drive.memory[:] = 0.0
        maneuver.drive.memory["travelled"] = distance - 0.01
        open_loop.apply_drive(0, outputs, inputs, maneuver.drive)
        wheels = inputs[ports.WHEEL_FRICTION : ports.WHEEL_FRICTION + 4]
        return inputs[ports.FRICTION] + wheels

    assert at(10.0) == pytest.approx([0.9, 0.9, 0.9, 0.9])
    assert at(19.0) == pytest.approx([0.45, 0.72, 0.9, 0.9])
    assert at(25.0) == pytest.approx([0.45, 0.72, 0.45, 0.72])


def test_a_speed_over_distance_is_driven(tmp_path):
    file = road_of(tmp_path, "distance,speed_kmh", "0,50", "30,50", "90,80")
    outputs = run("slalom", road=file, count=3, spacing=60)
    speed = 3.6 * np.interp([20.0, 60.0, 120.0], outputs[:, ports.X], outputs[:, ports.VX])
    assert speed == pytest.approx([50.0, 65.0, 80.0], abs=2.0)
    with pytest.raises(CanrollError, match="has a speed over time"):
        maneuvers.build("slalom", VAN, 60 / 3.6, road=file)


def test_a_grade_of_a_file_slows_a_car_that_coasts(tmp_path):
    file = road_of(tmp_path, "distance,grade_deg", "0,5", "500,5")
    level = run("power_off_in_curve", radius=10_000, acceleration=0.0)
    uphill = run("power_off_in_curve", radius=10_000, acceleration=0.0, road=file)
    lost = level[[5500, -1], ports.VX] - uphill[[5500, -1], ports.VX]
    slower = (lost[1] - lost[0]) / 4.0
    assert slower == pytest.approx(G * np.sin(radians(5)), rel=0.05)


@pytest.mark.parametrize(
    ("header", "rows", "words"),
    [
        ("distance,frction", ("0,1", "1,1"), "frction"),
        ("distance,friction_left", ("0,1", "1,1"), "both friction_left and friction_right"),
        ("distance,bank_deg", ("0,45", "1,0"), "bank_deg 45: must be -30 to 30"),
        ("distance,bank_deg", ("0,4", "0,5"), "line 3: distance must increase"),
        ("distance,bank_deg", ("0,4", "a,5"), "line 3: expected two numbers"),
        ("distance", ("0", "1"), "distance and one of"),
        ("s,bank_deg", ("0,4", "1,5"), "column of .* 's'"),
    ],
)
def test_a_road_that_is_none_is_refused_with_its_fault(tmp_path, header, rows, words):
    with pytest.raises(CanrollError, match=words):
        maneuvers.build("slalom", VAN, road=road_of(tmp_path, header, *rows))


def test_a_bump_is_half_a_sine_under_either_side_or_both():
    one = {"count": 1, "height": 0.04, "length": 1.0, "shape": "half_sine"}
    left, right, both = (
        maneuvers.build("bumps", VAN, side=side, **one).drive for side in ("left", "right", "both")
    )
    at = np.arange(20.0, 21.0, road.STEP)
    expected = 0.04 * np.sin(np.pi * (at - 20.0))
    middle = left.road_left[400 : 400 + len(at)]
    np.testing.assert_allclose(middle, expected, atol=1e-12)
    assert not left.road_right.any() and not right.road_left.any()
    assert (both.road_left == right.road_right).all() and both.road_left.any()
    with pytest.raises(UnknownNameError, match="side of bumps"):
        maneuvers.build("bumps", VAN, side="middle")
    with pytest.raises(UnknownNameError, match="shape of bumps"):
        maneuvers.build("bumps", VAN, shape="square")
