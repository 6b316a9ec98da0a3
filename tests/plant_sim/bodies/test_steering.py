"""Steering of the 14-DOF car: a ratio that changes with the angle, and what gives way."""

from math import atan, radians, sqrt, tan, tanh
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from support.car_bodies import steered

from canroll import vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import nonlinear_car, parameters, ports
from canroll.plant_sim.bodies.contact import FORWARD, LEFT
from canroll.plant_sim.driving.maneuvers import build
from canroll.plant_sim.world import handling, open_loop
from canroll.vehicles.axles import axles, road_wheels

BODY = bodies.body("nonlinear")
TYRE = Path(__file__).parents[2] / "vehicles" / "tyres" / "passenger_61.tir"
RATIO = 18.0
TURN = radians(720.0)
STIFFNESS, TRAIL = 2e4, 0.03


def steering(angle, points=145):
    """A table: the left wheel's angle is a function of the steering wheel's over the ratio."""
    wheel = np.linspace(-TURN, TURN, points)
    return {
        "steering_wheel [rad]": wheel.tolist(),
        "road_wheel [rad]": [angle(each / RATIO) for each in wheel],
    }


def quicker(steer):
    """Half as much again beyond 0.3 rad."""
    return steer * (1.0 + 0.5 * tanh((steer / 0.15) ** 2))


def car(*, base="van_real", tyre=False, **front):
    given = {"base": base, "title": "steered"}
    if front:
        given["axles"] = {"front": front}
    return vehicles.load(given | ({"tyre": {"file": str(TYRE)}} if tyre else {}))


def angles(vehicle, state, steer):
    """Turn of each wheel to the left (rad), from its force in its own axes and in the car's.

    The forces are along the trace on the road of a wheel that an axle leans and pitches.
    """
    inputs = ports.initial_inputs()
    inputs[ports.STEER] = steer
    rate, results = np.zeros(nonlinear_car.N_STATES), np.zeros(nonlinear_car.N_RESULTS)
    nonlinear_car.evaluate(state, inputs, BODY.build(vehicle, 20.0)[1], rate, results)
    along, across, ahead, left = (
        results[slot : slot + 4]
        for slot in (nonlinear_car.R_LONGITUDINAL, nonlinear_car.R_LATERAL, FORWARD, LEFT)
    )
    turned = np.arctan2(left, ahead) - np.arctan2(across, along)
    lean, pitch = leaning(vehicle, state), state[nonlinear_car.PITCH]
    tangent = (np.tan(turned) * np.cos(lean) + np.sin(pitch) * np.sin(lean)) / np.cos(pitch)
    return np.arctan(tangent), along, across


def leaning(vehicle, state):
    """Roll of each wheel with its axle (rad)."""
    travel = state[nonlinear_car.TRAVEL : nonlinear_car.TRAVEL + 4]
    tracks = [2 * axle.half_track for axle in axles(vehicle)]
    tilts = [-(travel[2 * k] - travel[2 * k + 1]) / tracks[k] for k in range(2)]
    return state[nonlinear_car.ROLL] + np.repeat(tilts, 2)


def test_a_table_of_constant_ratio_is_that_ratio():
    table = car(steering=steering(lambda steer: steer, points=7))
    assert table.steering.ratio == pytest.approx(RATIO, rel=1e-12)
    driven, wanted = (steered(each, 0.05, 2.0)[1] for each in (table, car()))
    np.testing.assert_allclose(driven, wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("steer", [0.07, -0.19])
def test_the_car_is_one_whose_road_wheels_are_turned_by_the_table(steer):
    vehicle = car(steering=steering(quicker))
    wheel = np.linspace(-TURN, TURN, 145) / RATIO
    on_line = np.interp(steer, wheel * RATIO / vehicle.steering.ratio, list(map(quicker, wheel)))
    assert abs(on_line) > 1.005 * abs(steer)
    state, _ = steered(vehicle, steer, 0.5)
    inputs = ports.initial_inputs()
    rates = []
    for each, angle in ((vehicle, steer), (car(), on_line)):
        inputs[ports.STEER] = angle
        rate, results = np.zeros(nonlinear_car.N_STATES), np.zeros(nonlinear_car.N_RESULTS)
        nonlinear_car.evaluate(state, inputs, BODY.build(each, 20.0)[1], rate, results)
        rates.append(np.concatenate([rate, results]))
    np.testing.assert_allclose(*rates, rtol=1e-9, atol=1e-9)


def test_steering_wheel_of_a_circle_by_the_textbook():
    """Gillespie, chapter 6: the wheels need l/R + K a_y, whatever ratio they are turned by."""
    radius, plain = 30.0, car()
    vehicle = car(steering=steering(quicker))
    assert vehicle.understeer == plain.understeer
    circles = []
    for lateral in (0.6, 1.2):
        speed = sqrt(lateral * radius)
        maneuver = build("constant_radius", vehicle, speed, radius=radius)
        outputs, steer = open_loop.run_passive(vehicle, BODY, maneuver)
        last = outputs[-handling.SETTLED :].mean(axis=0)
        curvature = last[ports.AY] / last[ports.VX] ** 2
        needed = atan(plain.geometry.wheelbase * curvature) + plain.understeer * last[ports.AY]
        wanted = RATIO * brentq(lambda steer, at=needed: quicker(steer) - at, 0.0, 0.7)
        wheel = steer[-handling.SETTLED :].mean() * vehicle.steering.ratio
        assert wheel == pytest.approx(wanted, rel=0.005)
        # with the ratio on centre it would be another
        assert abs(wheel - RATIO * needed) > 0.02 * wheel
        circles.append((wheel, wanted))
    (low, low_wanted), (high, high_wanted) = circles
    assert high - low == pytest.approx(high_wanted - low_wanted, rel=0.1)


def test_the_gradient_of_a_driven_circle_does_not_depend_on_the_table():
    plain, table = (
        handling.constant_radius(each, handling.passive(each, BODY), radius=30.0)
        for each in (car(), car(steering=steering(quicker)))
    )
    assert table.closed_form == plain.closed_form
    assert table.gradient == pytest.approx(plain.gradient, rel=0.01)
    steers = [[state.steer for state in each.states[:3]] for each in (plain, table)]
    assert (np.array(steers[1]) < 0.99 * np.array(steers[0])).all()


def geometric(vehicle):
    """Angles of the left wheel at which both front axles' normals meet on the rear axle's."""
    length, track = vehicle.geometry.wheelbase, vehicle.geometry.half_track_front

    def angle(steer):
        return atan(length * tan(steer) / (length - track * tan(steer)))

    return angle


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_with_ackermann_angles_the_front_wheels_slip_alike(side):
    vehicle = car(steering=steering(geometric(car())))
    length, track = vehicle.geometry.wheelbase, 2.0 * vehicle.geometry.half_track_front
    steer, apart = side * 0.12, []
    for each in (car(), vehicle):
        state, outputs = steered(each, steer, 4.0, 5.0)
        left, right = np.arctan(state[nonlinear_car.SLIP : nonlinear_car.SLIP + 2])
        yaw_rate, vx = outputs[[ports.YAW_RATE, ports.VX]]
        across = outputs[ports.VY] + vehicle.geometry.cg_to_front_axle * yaw_rate
        courses = [np.arctan2(across, vx - y * yaw_rate) for y in (track / 2, -track / 2)]
        # what the wheels' courses differ by, less what the wheels do
        turned = courses[0] - courses[1] - (right - left)
        apart.append((right - left, turned))
    (parallel, none), (alike, ackermann) = apart
    assert abs(none) < 1e-5 and parallel > radians(0.3)
    assert abs(alike) < 0.15 * parallel
    # cot of the outer less cot of the inner angle is track over wheelbase
    cot = 1.0 / tan(abs(steer))
    inner, outer = (atan(1.0 / (cot + sign * track / 2 / length)) for sign in (-1.0, 1.0))
    assert ackermann == pytest.approx(inner - outer, rel=2e-3)
    assert road_wheels(vehicle, steer) == pytest.approx(side * 0.5 * (inner + outer), rel=1e-4)


def held(**more):
    return {"steering_system": {"torsional_stiffness": STIFFNESS, "caster_trail": TRAIL} | more}


@pytest.mark.parametrize("tyre", [False, True])
def test_both_wheels_give_way_alike_to_the_sum_of_their_moments(tyre):
    base = {"base": "sedan_320i", "tyre": tyre}
    vehicle = car(**base, **held())
    state, _ = steered(vehicle, 0.03, 2.0)
    # one wheel slips much more than the other
    state[nonlinear_car.SLIP : nonlinear_car.SLIP + 2] = 0.1, 0.005
    turned, along, across = angles(vehicle, state, 0.03)
    inputs = ports.initial_inputs()
    inputs[ports.STEER] = 0.03
    rate, results = np.zeros(nonlinear_car.N_STATES), np.zeros(nonlinear_car.N_RESULTS)
    nonlinear_car.evaluate(state, inputs, BODY.build(vehicle, 20.0)[1], rate, results)
    load = results[:4]
    wheels = axles(vehicle)[0].tyre
    aligning = 0.0
    for wheel in range(2):
        # along is small: its slip ratio is found from the force
        axis = -np.sin(turned[wheel]), np.cos(turned[wheel])
        lean = leaning(vehicle, state)[wheel]
        inclined = axis[1] * np.sin(lean) * np.cos(state[nonlinear_car.PITCH])
        inclined -= axis[0] * np.sin(state[nonlinear_car.PITCH])
        slip = state[nonlinear_car.SLIP + wheel]
        hand = 1.0 - 2.0 * wheel
        ratio = ratio_of(wheels, along[wheel], load[wheel], slip, inclined, 1.0, hand)
        _, lateral, moment = wheels.forces(load[wheel], ratio, slip, inclined, 1.0, hand)
        assert lateral == pytest.approx(across[wheel], rel=1e-5)
        aligning += moment
    assert across[0] > 1.5 * across[1] > 0.0
    wanted = (aligning - TRAIL * (across[0] + across[1])) / STIFFNESS
    assert wanted < -2e-3 and (aligning < -10.0) == tyre
    np.testing.assert_allclose(turned[:2] - 0.03, wanted, rtol=1e-4)
    np.testing.assert_allclose(turned[2:], 0.0, atol=1e-9)


def ratio_of(tyre, along, load, *rest):
    low, high = -0.1, 0.1
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = tyre.forces(load, middle, *rest)[0] < along
        low, high = (middle, high) if below else (low, middle)
    return low


def beyond(vehicle, lateral=0.5, radius=100.0):
    """Steering beyond that of the curve, per lateral acceleration."""
    maneuver = build("constant_radius", vehicle, sqrt(lateral * radius), radius=radius)
    outputs, steer = open_loop.run_passive(vehicle, BODY, maneuver)
    last = outputs[-handling.SETTLED :].mean(axis=0)
    curvature = last[ports.AY] / last[ports.VX] ** 2
    more = steer[-handling.SETTLED :].mean() - vehicle.geometry.wheelbase * curvature
    return more / last[ports.AY]


SYMMETRIC = {
    f"magic_formula.{axle}.{key}": 0.0
    for axle in ("front", "rear")
    for key in ("LHY", "LVY", "LRES")
}
"""Without them a tyre pulls to one side, and that changes with the load."""


@pytest.mark.parametrize("tyre", [False, True])
def test_steering_compliance_adds_the_term_of_the_textbook(tyre):
    """Gillespie, chapter 6: W_f (r ν + p) / K_ss, r ν the caster trail, p the pneumatic one."""
    base = {"base": "sedan_320i", "tyre": tyre}
    stiff, soft = (
        each.replace(SYMMETRIC if tyre else {}) for each in (car(**base), car(**base, **held()))
    )
    geometry, front = stiff.geometry, axles(stiff)[0]
    trail = 0.0
    if tyre:
        # where the force of a small slip acts, by the file's forces
        pairs = (front.tyre.forces(front.wheel_load, 0.0, slip)[1:] for slip in (1e-3, -1e-3))
        force, moment = np.subtract(*pairs)
        trail = -moment / force
        assert 0.01 < trail < 0.06
    mass = stiff.total_mass * geometry.cg_to_rear_axle / geometry.wheelbase
    wanted = mass * (TRAIL + trail) / STIFFNESS
    assert soft.understeer - stiff.understeer == pytest.approx(wanted, rel=2e-3)
    # the closed form's front axle does not carry the moments of trail and camber
    assert beyond(soft) - beyond(stiff) == pytest.approx(wanted, rel=0.05 if tyre else 0.015)


def test_a_stiff_steering_is_none_and_a_softer_one_gives_way_by_its_stiffness():
    base = {"base": "sedan_320i"}
    plain = steered(car(**base), 0.04, 2.0)[1]
    stiff = steered(car(**base, **held(torsional_stiffness=1e13)), 0.04, 2.0)[1]
    np.testing.assert_allclose(stiff, plain, rtol=1e-6, atol=1e-6)
    changes = [
        car(**base, **held(torsional_stiffness=each)).understeer - car(**base).understeer
        for each in (1e4, 2e4)
    ]
    assert changes[0] == pytest.approx(2.0 * changes[1], rel=1e-6)


def test_mirrored_steering_gives_the_mirrored_run():
    vehicle = car(base="sedan_320i", tyre=True, steering=steering(geometric(car())), **held())
    left, right = (steered(vehicle, steer, 2.0)[1] for steer in (0.05, -0.05))
    for slot in (ports.Y, ports.YAW, ports.ROLL, ports.AY, ports.VY, ports.YAW_RATE):
        assert left[slot] == pytest.approx(-right[slot], rel=1e-9)


def test_linear_plants_say_what_they_lack():
    both = car(steering=steering(quicker), **held())
    assert list(BODY.left_out(both)) == []
    for name in ("roll1", "linear_car"):
        body = bodies.body(name)
        (ratio,) = body.left_out(car(steering=steering(quicker)))
        (compliance,) = body.left_out(car(**held()))
        assert "table of its steering" in ratio and "gives way" in compliance
        assert list(body.left_out(both)) == [ratio, compliance]


def test_a_car_without_these_has_neither():
    record = parameters.build_parameters(car()).view(parameters.CAR)[0]
    assert record["steering_compliance"] == record["attitudes"] == 0.0
