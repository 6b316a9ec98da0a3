"""The noncausal bound: against a toy in closed form, a convex solver, and other moments."""

from itertools import pairwise

import cvxpy as cp
import numpy as np
import pytest
from scipy.linalg import expm, toeplitz
from scipy.optimize import brentq

from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.world.linearise import find_trim, linearise
from canroll.plant_sim.world.open_loop import moment_response
from canroll.runs.experiment import drive, plan
from canroll.runs.metrics import rms
from canroll.studies.bound import HELD, EffortBound, bound_of


def oscillator(count=60, tick=0.02, frequency=1.4, damping=0.3, stiffness=1e5):
    """Return φ after 1 N·m held for a tick, of one degree of freedom, rad."""
    t = tick * np.arange(1, count + 1)
    w = 2 * np.pi * frequency
    own = w * np.sqrt(1 - damping**2)

    def step(time):
        late = np.maximum(time, 0.0)
        ringing = np.cos(own * late) + damping * w / own * np.sin(own * late)
        return np.where(time > 0, (1 - np.exp(-damping * w * late) * ringing) / stiffness, 0.0)

    return step(t) - step(t - tick)


def swing(count=60):
    """Return a passive roll angle, rad."""
    t = np.linspace(0.0, 1.0, count)
    return 0.03 * np.sin(2 * np.pi * 1.3 * t) * np.exp(-t)


def test_a_static_plant_has_a_closed_form():
    """H = h I: the moment opposes the roll angle, so that the bound is rms φ − h M."""
    roll, gain = swing(), 1e-5
    bound = EffortBound.of(roll, np.concatenate([[gain], np.zeros(len(roll) - 1)]))
    for effort in (0.0, 200.0, 900.0):
        assert bound.at(effort) == pytest.approx(rms(roll) - gain * effort, rel=1e-9)
    assert bound.at(1.01 * rms(roll) / gain) == 0.0


@pytest.mark.parametrize("effort", [100.0, 600.0, 1500.0])
def test_a_convex_solver_agrees(effort):
    roll, response = 1e3 * swing(), 1e3 * oscillator()
    moment = cp.Variable(len(roll))
    lower = toeplitz(response, np.zeros(len(roll)))
    problem = cp.Problem(
        cp.Minimize(cp.norm(roll + lower @ moment)),
        [cp.norm(moment) <= effort * np.sqrt(len(roll))],
    )
    least = problem.solve(solver=cp.CLARABEL) / np.sqrt(len(roll))
    assert EffortBound.of(roll, response).at(effort) == pytest.approx(least, rel=1e-5)


def test_no_moment_of_that_effort_does_better():
    rng = np.random.default_rng(3)
    roll, response = swing(), oscillator()
    bound, lower = EffortBound.of(roll, response), toeplitz(response, np.zeros(len(roll)))
    for _ in range(200):
        moment = np.convolve(rng.normal(size=len(roll)), np.ones(9), "same") - 4e4 * roll
        assert rms(roll + lower @ moment) > bound.at(rms(moment))


def test_more_effort_leaves_less_roll():
    bound = EffortBound.of(swing(), oscillator())
    left = [bound.at(effort) for effort in (0.0, 100.0, 500.0, 1000.0, 2000.0)]
    assert all(after < before for before, after in pairwise(left))
    assert left[0] == pytest.approx(rms(swing()))


def response_of(body, held, count):
    settings, _ = plan("double_lane_change", law="passive")
    return moment_response(
        settings.vehicle, bodies.body(body), 20.0, front_share=0.5, held=held, count=count
    )


def test_longer_pulses_are_sums_of_shorter_ones():
    """The 14-DOF car answers a small pulse as a linear one, though its dampers are bilinear."""
    short = response_of("nonlinear", 0.005, 200)
    late = np.concatenate([[0.0], short[:-1]])
    long = response_of("nonlinear", 0.010, 100)
    assert long == pytest.approx((short + late)[1::2], abs=1e-4 * np.max(long))


def test_a_step_ends_at_the_static_roll_angle():
    """A step is the sum of pulses: its end is the roll angle that K − m g h gives."""
    plant = plan("double_lane_change", law="passive")[0].vehicle.plant
    assert np.sum(response_of("roll1", HELD, 400)) == pytest.approx(
        1.0 / plant.effective_stiffness, rel=1e-3
    )


@pytest.mark.parametrize("effort", [800, 1600, 3200])
def test_the_van_in_a_lane_change(effort):
    """Against the matrix exponential of the linearised plant, and ridge regression."""
    settings, controller = plan(
        "double_lane_change", law="passive", plant="nonlinear", actuator="suspension"
    )
    trace = drive(settings, controller, enabled=False)
    time, roll = trace.signals["time"], trace.signals["roll"]
    trim = find_trim(settings.vehicle, bodies.body("nonlinear"), speed=settings.speed)
    plant = linearise(trim)
    share = controller.front_share(settings.speed)
    moment = share * plant.b[:, ports.BAR_MOMENT_FRONT]
    moment = moment + (1.0 - share) * plant.b[:, ports.BAR_MOMENT_REAR]
    n = len(moment)
    held = expm(HELD * np.block([[plant.a, moment[:, None]], [np.zeros((1, n + 1))]]))
    phi, state = held[:n, :n], held[:n, n]
    ends = HELD * np.arange(1, int(time[-1] / HELD + 1e-9) + 1)
    pulse = []
    for _ in ends:
        pulse.append(plant.c[ports.ROLL] @ state)
        state = phi @ state
    response, free = toeplitz(pulse, np.zeros(len(pulse))), np.interp(ends, time, roll)

    def chosen(log_weight):
        normal = response.T @ response + np.exp(log_weight) * np.eye(len(free))
        return -np.linalg.solve(normal, response.T @ free)

    weight = brentq(lambda w: rms(chosen(w)) - effort, -45.0, -10.0)
    wanted = rms(free + response @ chosen(weight))
    assert bound_of(settings, controller, time, roll).at(effort) == pytest.approx(wanted, rel=2e-3)
