"""The data sheet's linear car against the 14-DOF plant linearised numerically; its reduction."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.gain_gen.models.linear_car import OUTPUTS, linear_car
from canroll.gain_gen.models.reduction import INPUT_SIZES, OUTPUT_SIZES, reduced
from canroll.gain_gen.models.trim import most_lateral_acceleration, steady_curve
from canroll.plant_sim.bodies import nonlinear_car, ports
from canroll.plant_sim.nodes.imu_motion import FORCE, RATE, specific_motion
from canroll.vehicles.axles import axles
from canroll.vehicles.roll_stiffness import steady_roll, suspension_roll_stiffness
from canroll.vehicles.unladen import empty_body, unladen

FREQUENCIES = 2.0 * np.pi * np.geomspace(0.05, 10.0, 200)
KMH = 1.0 / 3.6
PLANAR = 4
"""Position, heading and speed: neither moves what is compared."""


@pytest.fixture(scope="module")
def van():
    return vehicles.load("van_real")


def plant_response(vehicle, speed):
    """Return the plant's response to moment and steering, by central differences."""
    state, parameters = nonlinear_car.build(vehicle, speed)
    geometry = vehicle.geometry
    share = geometry.static_front_share
    front, rear = 0.5 / geometry.half_track_front, 0.5 / geometry.half_track_rear
    split = np.array([share * front, -share * front, (1 - share) * rear, -(1 - share) * rear])
    arm = np.array(vehicle.sensors.imu_position)

    def evaluate(point):
        inputs = ports.initial_inputs()
        inputs[ports.CORNER_FORCE : ports.CORNER_FORCE + 4] = point[-2] * split
        inputs[ports.STEER] = point[-1]
        at, rate = np.concatenate([point[:-2], [0.0, 0.0]]), np.zeros(len(state))
        nonlinear_car.derivative(at, inputs, parameters, rate)
        seen, motion = np.zeros(ports.N_OUTPUTS), np.zeros(6)
        nonlinear_car._observe(at, inputs, parameters, seen, 0.0)
        specific_motion(inputs, seen, arm, motion)
        felt = [motion[RATE], motion[FORCE + 1]]
        return np.concatenate([rate[:-2], felt, seen[[ports.ROLL, ports.YAW_RATE, ports.AY]]])

    start = np.concatenate([state[:-2], [0.0, 0.0]])
    steps = np.concatenate([1e-6 * np.maximum(1.0, np.abs(state[:-2])), [1.0, 1e-6]])
    columns = [
        (evaluate(start + d) - evaluate(start - d)) / (2.0 * d.sum()) for d in np.diag(steps)
    ]
    jacobian = np.stack(columns, axis=1)
    n = len(state) - 2
    a, b = jacobian[PLANAR:n, PLANAR:n], jacobian[PLANAR:n, n:]
    c, d = jacobian[n:, PLANAR:n], jacobian[n:, n:]
    eye = np.eye(len(a))
    return np.array([c @ np.linalg.solve(1j * w * eye - a, b) + d for w in FREQUENCIES])


def distance(found, expected):
    """Return the greatest error of each channel over its peak."""
    return np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0)


@pytest.mark.parametrize("load", ["laden", "empty"])
@pytest.mark.parametrize("speed", [40, 80, 120])
def test_data_sheet_car_is_within_two_percent_of_the_plant(van, load, speed):
    vehicle = unladen(van) if load == "empty" else van
    expected = plant_response(vehicle, speed * KMH)
    whole = linear_car(vehicle, speed * KMH)
    error = distance(whole.response(FREQUENCIES)[:, :, :2], expected)
    assert error[: OUTPUTS.index("yaw_rate")].max() < 0.02
    assert error[:3, 0].max() < 0.01  # by the moment
    eight = distance(reduced(whole, 8).response(FREQUENCIES)[:, :, :2], expected)
    assert eight[:3].max() < 0.02


@pytest.mark.parametrize("name", ["car_2020", "suv_2020", "van_2021"])
def test_data_sheet_cars_of_the_papers_are_near_their_plants(name):
    vehicle = vehicles.load(name)
    expected = plant_response(vehicle, 80 * KMH)
    found = linear_car(vehicle, 80 * KMH).response(FREQUENCIES)[:, :, :2]
    assert distance(found, expected)[:3].max() < 0.02


def test_a_steady_curve_softens_the_tyres_as_the_plants_own_tyre_does(van):
    acceleration, friction = 5.0, 0.9
    front, _ = steady_curve(van, acceleration, friction)
    data, wheel = van.tyre, axles(van)[0].tyre
    share = van.geometry.static_front_share
    static = 0.5 * share * van.total_mass * 9.81
    tilt = steady_roll(van, suspension_roll_stiffness(van))[1]
    moved = data.vertical_stiffness * van.geometry.half_track_front * tilt * acceleration

    # rolling resistance, a couple of the road, moves load to the rear
    resistance = data.rolling_resistance * van.total_mass * 9.81
    back = 0.5 * resistance * data.radius / van.geometry.wheelbase

    def force(slip):
        total = 0.0
        for load in (static - back - moved, static - back + moved):
            total += wheel.forces(load, 0.0, slip, 0.0, friction)[1]
        return total

    slips = np.linspace(0.0, 0.2, 20001)
    forces = np.array([force(slip) for slip in slips])
    at = np.searchsorted(forces, share * van.total_mass * acceleration)
    slope = (forces[at + 1] - forces[at - 1]) / (slips[at + 1] - slips[at - 1])
    assert front.cornering == pytest.approx(slope, rel=1e-3)
    assert front.cornering < 0.8 * data.cornering_stiffness_front


def test_a_curve_beyond_grip_is_refused(van):
    most = most_lateral_acceleration(van, 0.5)
    assert 4.0 < most < 0.5 * 9.81
    with pytest.raises(CanrollError, match=r"no steady curve of 6 m/s² at friction 0\.5"):
        steady_curve(van, 6.0, 0.5)


def test_the_empty_car_keeps_its_springs_and_loses_cornering_stiffness(van):
    empty = unladen(van)
    assert empty.total_mass == pytest.approx(1940.0)
    assert suspension_roll_stiffness(empty) == pytest.approx(suspension_roll_stiffness(van))
    ratio = empty.tyre.cornering_stiffness_front / van.tyre.cornering_stiffness_front
    assert empty.total_mass / van.total_mass < ratio < 1.0
    by_rule = empty_body(replace(van, empty=None))
    assert by_rule.sprung_mass == pytest.approx(0.75 * van.plant.sprung_mass)


def test_reduction_is_balanced_and_keeps_what_is_steady(van):
    model = linear_car(van, 80 * KMH)
    b, c = model.b * INPUT_SIZES, model.c[:3] / OUTPUT_SIZES[:3, None]
    reach = solve_continuous_lyapunov(model.a, -b @ b.T)
    observe = solve_continuous_lyapunov(model.a.T, -c.T @ c)
    values = np.sort(np.sqrt(np.linalg.eigvals(reach @ observe).real))[::-1]
    assert model.balanced(INPUT_SIZES, OUTPUT_SIZES)[1] == pytest.approx(values, rel=1e-5)
    whole = control.ss(model.a, model.b, model.c, model.d)
    assert whole(20j) == pytest.approx(model.response(np.array([20.0]))[0])
    for order in (4, 6, 8):
        smaller = reduced(model, order)
        assert np.linalg.eigvals(smaller.a).real.max() < 0.0
        zero = np.zeros(1)
        assert smaller.response(zero) == pytest.approx(model.response(zero), rel=1e-6, abs=1e-12)
