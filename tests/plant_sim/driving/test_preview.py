"""The preview driver's steering is the least-squares best on a bicycle written another way."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from canroll import vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.driving import maneuvers, preview, standards
from canroll.plant_sim.world.open_loop import run_passive, signals

SEDAN = vehicles.load("sedan_320i")


def bicycle(vehicle, speed, start, demand, times):
    """Lateral position at ``times`` from forces and slip angles, integrated by scipy."""
    a, b = vehicle.geometry.cg_to_front_axle, vehicle.geometry.cg_to_rear_axle

    def rates(_time, now):
        _, yaw, across, turning, angle = now
        front = vehicle.tyre.cornering_stiffness_front * (angle - (across + a * turning) / speed)
        rear = vehicle.tyre.cornering_stiffness_rear * (b * turning - across) / speed
        return (
            across + speed * yaw,
            turning,
            (front + rear) / vehicle.total_mass - speed * turning,
            (a * front - b * rear) / vehicle.mass.yaw_inertia,
            (demand - angle) / vehicle.driver.lag,
        )

    run = solve_ivp(rates, (0.0, times[-1]), start, t_eval=times, rtol=1e-10, atol=1e-12)
    return run.y[0]


@settings(max_examples=25, deadline=None)
@given(
    name=st.sampled_from(vehicles.names()),
    speed=st.floats(5.0, 40.0),
    time=st.floats(0.3, 2.0),
    path=st.lists(st.floats(-3.0, 3.0), min_size=preview.POINTS, max_size=preview.POINTS),
    state=st.tuples(st.floats(-1.0, 1.0), st.floats(-0.5, 0.5), st.floats(-0.1, 0.1)),
)
def test_demand_is_the_least_squares_best(name, speed, time, path, state):
    vehicle = vehicles.load(name)
    times = time / preview.POINTS * np.arange(1, preview.POINTS + 1)
    free = bicycle(vehicle, speed, (0.0, 0.0, *state), 0.0, times)
    steered = bicycle(vehicle, speed, np.zeros(5), 1.0, times)
    best = np.linalg.lstsq(steered[:, None], np.array(path) - free, rcond=None)[0][0]
    per_offset, per_state = preview.gains(*preview.bicycle(vehicle, speed), time)
    demand = per_offset @ path - per_state @ np.array([0.0, 0.0, *state])
    assert demand == pytest.approx(best, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("name", vehicles.names())
@pytest.mark.parametrize("speed", [10.0, 22.0, 35.0])
def test_preview_is_the_shortest_that_damps(name, speed):
    vehicle = vehicles.load(name)

    def damping(time):
        a, b = preview.bicycle(vehicle, speed)
        closed = a - np.outer(b, preview.gains(a, b, time)[1])
        return min(-pole.real / abs(pole) for pole in np.linalg.eigvals(closed))

    time = preview.preview_time(vehicle, speed)
    assert damping(time) >= preview.DAMPING
    shorter = time - 0.02
    assert shorter < preview.LAGS * vehicle.driver.lag or damping(shorter) < preview.DAMPING


def test_a_circle_is_followed_without_error():
    maneuver = maneuvers.build("constant_radius", SEDAN, 15.0, radius=200.0)
    outputs, _ = run_passive(SEDAN, bodies.body("linear_car"), maneuver)
    assert abs(outputs[-1, ports.PATH_ERROR]) < 0.01
    assert outputs[-1, ports.VX] / outputs[-1, ports.YAW_RATE] == pytest.approx(200.0, rel=2e-3)


def test_front_tyres_stay_near_their_peak():
    maneuver = maneuvers.build("moose", SEDAN, 90 / 3.6, friction=0.5)
    most = maneuver.drive.parameters["slip_limit"][0]

    def slip():
        outputs, steer = run_passive(SEDAN, bodies.body("nonlinear"), maneuver)
        across = outputs[:, ports.VY] + SEDAN.geometry.cg_to_front_axle * outputs[:, ports.YAW_RATE]
        return np.abs(steer[1:] - np.arctan(across / outputs[:, ports.VX])[:-1]).max()

    # the arms lag behind the demand
    assert most < slip() < 1.6 * most
    maneuver.drive.parameters["slip_limit"] = np.inf
    maneuver.drive.memory[:] = 0.0
    assert slip() > 2.0 * most


@pytest.mark.parametrize("name", vehicles.names())
def test_every_preset_clears_the_double_lane_change(name):
    # the standard's course, not the one fitted to a paper
    vehicle = replace(vehicles.load(name), lane_offset=3.5)
    maneuver = maneuvers.build("double_lane_change", vehicle, 80 / 3.6)
    outputs, steer = run_passive(vehicle, bodies.body("nonlinear"), maneuver)
    judged = standards.judge("double_lane_change", vehicle, signals(outputs, steer))
    assert all(verdict.passed for verdict in judged)
