from dataclasses import replace
from itertools import pairwise

import control
import numpy as np
import pytest

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.plant_sim import bodies
from canroll.plant_sim.world import handling

VAN = vehicles.load("van_real")


@pytest.mark.parametrize("name", ["van_real", "suv_2020"])
def test_gradients_of_the_linear_plant_equal_their_closed_forms(name):
    vehicle = vehicles.load(name)
    result = handling.constant_radius(
        vehicle, handling.passive(vehicle, bodies.body("roll1")), radius=80.0
    )
    assert result.gradient == pytest.approx(result.closed_form, rel=0.01)
    assert result.roll_gradient == pytest.approx(vehicle.plant.roll_gradient_deg_per_g, rel=0.01)


def test_nonlinear_car_understeers_more_and_ends_at_its_grip():
    result = handling.constant_radius(VAN, handling.passive(VAN, bodies.body("nonlinear")))
    assert result.closed_form < result.gradient < 1.3 * result.closed_form
    assert result.roll_gradient == pytest.approx(VAN.plant.roll_gradient_deg_per_g, rel=0.02)
    assert 0.6 * vehicles.GRAVITY < result.limit < VAN.tyre.friction * vehicles.GRAVITY
    steers = [state.steer for state in result.states]
    assert all(a < b for a, b in pairwise(steers))


def test_radius_is_checked():
    with pytest.raises(CanrollError, match="--radius must be at least 20 m"):
        handling.constant_radius(VAN, handling.passive(VAN, bodies.body("roll1")), radius=5.0)


def bicycle_with_roll(vehicle, speed):
    """Steering to yaw rate, lateral acceleration and roll by python-control, from the textbook."""
    a, b = vehicle.geometry.cg_to_front_axle, vehicle.geometry.cg_to_rear_axle
    cf, cr = vehicle.tyre.cornering_stiffness_front, vehicle.tyre.cornering_stiffness_rear
    m, iz, roll = vehicle.total_mass, vehicle.mass.yaw_inertia, vehicle.plant
    system = np.zeros((4, 4))
    system[0, :2] = -(cf + cr) / (m * speed), -(a * cf - b * cr) / (m * speed) - speed
    system[1, :2] = -(a * cf - b * cr) / (iz * speed), -(a * a * cf + b * b * cr) / (iz * speed)
    lateral = system[0] + np.array([0, speed, 0, 0])
    system[2, 3] = 1.0
    system[3] = roll.roll_arm / roll.roll_inertia * lateral
    system[3, 2] -= roll.effective_stiffness / roll.roll_inertia
    system[3, 3] -= roll.roll_damping / roll.roll_inertia
    drive = np.array([[cf / m], [a * cf / iz], [0], [roll.roll_arm * cf / m / roll.roll_inertia]])
    output = np.array([[0, 1, 0, 0], lateral, [0, 0, 1, 0]])
    return control.ss(system, drive, output, [[0], [cf / m], [0]])


def test_frequency_response_equals_python_control():
    speed = 25.0
    frequencies = np.array([0.25, 0.8, 2.0, 4.0])
    ours = handling.frequency_response(
        VAN, handling.passive(VAN, bodies.body("roll1")), speed=speed, frequencies=frequencies
    )
    # The test drives whole milliseconds a period.
    driven = 1e3 / np.round(1e3 / frequencies)
    theirs = bicycle_with_roll(VAN, speed)(2j * np.pi * driven)
    assert ours.yaw_rate == pytest.approx(theirs[0, 0], rel=0.002)
    assert ours.roll == pytest.approx(theirs[2, 0], rel=0.002)
    # The tyres answer at once to steering that is held over each step: half a millisecond.
    assert ours.lateral_acceleration == pytest.approx(theirs[1, 0], rel=0.016)


def test_nonlinear_car_lags_the_linear_one_by_its_tyres():
    frequencies = np.array([0.3, 2.0])
    linear, car = (
        handling.frequency_response(
            VAN, handling.passive(VAN, bodies.body(name)), frequencies=frequencies
        )
        for name in ("roll1", "nonlinear")
    )
    assert np.abs(car.yaw_rate[0]) == pytest.approx(np.abs(linear.yaw_rate[0]), rel=0.03)
    assert np.angle(car.yaw_rate[1]) < np.angle(linear.yaw_rate[1])


def test_bisection_brackets_the_edge():
    calls = []

    def fails(speed):
        calls.append(speed)
        return speed > 21.3

    found = handling.bisect_speed(fails, low=10.0, high=30.0, tolerance=0.1)
    assert found.passed <= 21.3 < found.failed and found.failed - found.passed <= 0.1
    assert len(calls) < 12
    assert handling.bisect_speed(lambda v: True, low=1, high=2, tolerance=0.1).passed is None
    assert handling.bisect_speed(lambda v: False, low=1, high=2, tolerance=0.1).failed is None


def test_understeer_of_a_neutral_car_is_zero():
    geometry = replace(VAN.geometry, cg_to_front_axle=1.8, cg_to_rear_axle=1.8)
    tyre = replace(VAN.tyre, cornering_stiffness_front=1.5e5, cornering_stiffness_rear=1.5e5)
    assert replace(VAN, geometry=geometry, tyre=tyre).understeer == 0.0
