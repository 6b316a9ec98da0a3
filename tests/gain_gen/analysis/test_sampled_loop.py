"""The sampled loop and its margins against simulation, python-control and a fine integration."""

from dataclasses import replace

import control
import numpy as np
import pytest

from canroll.gain_gen.analysis.margins import largest_delay_from, margins
from canroll.gain_gen.analysis.sampled_loop import build, loop_gain, roll_rms, spectral_radius
from canroll.gain_gen.laws.state_gains import lqr, yim_weights
from canroll.gain_gen.models.controller import LinearController, matrices, step
from canroll.gain_gen.models.observer import LateralModel, SensorNoise, kalman, observer_model
from canroll.gain_gen.models.roll import state_matrix
from canroll.vehicles import GRAVITY, load

TICK = 0.01
LAG = 0.015


@pytest.fixture(scope="module")
def van():
    return load("van_2021").design


@pytest.fixture(scope="module")
def state_controller(van):
    observer = kalman(observer_model(van, TICK, lateral=LateralModel(), noise=SensorNoise()))
    return LinearController(
        tick=TICK,
        observer=observer,
        feedback=np.array([7000.0, 2000.0, 0.0, 0.0, 0.0]),
        feedforward=np.array([0.0, 0.0, 240.0, 9.0, 0.0]),
        predict_steps=4,
        actuator_rate=1.0 - np.exp(-TICK / LAG),
    )


def rate_controller(observer, gain):
    return LinearController(
        tick=TICK,
        observer=observer,
        feedback=np.zeros(5),
        feedforward=np.zeros(5),
        output_gain=np.array([gain, 0.0, 0.0]),
    )


def simulate(van, controller, delay, seconds, *, substep=1e-4):
    """Euler steps of 0.1 ms with commands that come into force ``delay`` after their sample."""
    a = state_matrix(van)
    x = np.array([0.05, 0.0])
    moment, state = 0.0, np.zeros(controller.order)
    due: list[tuple[int, float]] = []
    command = 0.0
    per_tick = round(TICK / substep)
    roll = []
    for k in range(round(seconds / substep)):
        if k % per_tick == 0:
            y = np.array([x[1], GRAVITY * x[0], x[0], moment])
            state, u = step(controller, state, y)
            due.append((k + round(delay / substep), float(u)))
        while due and due[0][0] <= k:
            command = due.pop(0)[1]
        moment += substep / LAG * (command - moment)
        x = x + substep * (a @ x + np.array([0.0, moment / van.roll_inertia]))
        roll.append(x[0])
    return np.array(roll)


@pytest.mark.parametrize("delay", [0.0, 0.013, 0.04])
def test_loop_matrix_matches_a_fine_simulation(van, state_controller, delay):
    loop = build(van, state_controller, delay=delay, lag=LAG)
    x = np.zeros(len(loop.a))
    x[0] = 0.05
    expected = simulate(van, state_controller, delay, 1.0)[:: round(TICK / 1e-4)]
    found = []
    for _ in range(len(expected)):
        found.append(x[0])
        x = loop.closed @ x
    np.testing.assert_allclose(found, expected, atol=1.5e-4)


def test_controller_matrices_are_its_step(state_controller):
    a, b, c, d = matrices(state_controller)
    rng = np.random.default_rng(1)
    state, y = rng.normal(size=9), rng.normal(size=4)
    following, u = step(state_controller, state, y)
    np.testing.assert_allclose(a @ state + b @ y, following, rtol=1e-12)
    np.testing.assert_allclose(c @ state + d @ y, [u], rtol=1e-12)


def test_margins_agree_with_python_control(van):
    """LQR on the van: python-control's stability margins of the same loop transfer function."""
    observer = kalman(observer_model(van, TICK, lateral=LateralModel(), noise=SensorNoise()))
    gain = lqr(van, TICK, yim_weights(van))[0]
    controller = LinearController(TICK, observer, np.append(gain, np.zeros(3)), np.zeros(5))
    loop = build(van, controller, delay=0.02, lag=LAG)
    found = margins(loop)
    system = control.StateSpace(loop.a, loop.b, -loop.c, 0, TICK)
    # as frequency response: the polynomial method loses its digits at this order
    response = control.frd(system, np.geomspace(0.1, np.pi / TICK, 4000))
    gains, phases, modulus, *_ = control.stability_margins(response, returnall=True)
    assert found.gain_db == pytest.approx(abs(20 * np.log10(gains[0])), rel=1e-3)
    assert found.phase_deg == pytest.approx(abs(phases[0]), rel=1e-3)
    assert found.modulus == pytest.approx(min(modulus), rel=1e-2)


def test_largest_delay_separates_decay_from_growth(van):
    observer = kalman(observer_model(van, TICK, lateral=LateralModel(), noise=SensorNoise()))
    controller = rate_controller(observer, -7400.0)

    def stable(seconds):
        return spectral_radius(build(van, controller, delay=seconds, lag=LAG)) < 1.0

    largest = largest_delay_from(0.0, stable, TICK, limit=1.0)
    # the exact continuous figure 0.141 s less the hold's half tick and the actuator's lag
    assert largest == pytest.approx(0.141 - 0.5 * TICK - LAG, abs=0.006)
    below = np.abs(simulate(van, controller, largest - 0.01, 5.0))
    above = np.abs(simulate(van, controller, largest + 0.01, 5.0))
    assert below[40000:].max() < below[20000:30000].max()
    assert above[40000:].max() > above[20000:30000].max()


def test_roll_rms_is_that_of_a_long_simulation(van, state_controller):
    loop = build(van, state_controller, delay=0.02, lag=LAG)
    rng = np.random.default_rng(3)
    x = np.zeros(len(loop.a))
    samples = []
    for _ in range(60000):
        x = loop.closed @ x + loop.noise[:, 0] * rng.normal()
        samples.append(x[0])
    assert roll_rms(loop) == pytest.approx(float(np.std(samples)), rel=0.08)
    assert (
        roll_rms(
            build(van, replace(state_controller, feedback=np.full(5, -1e6)), delay=0.02, lag=LAG)
        )
        == np.inf
    )


def test_loop_gain_closes_to_the_closed_loop(van, state_controller):
    """1 + L vanishes at the closed loop's eigenvalues: det ratio identity at a test frequency."""
    loop = build(van, state_controller, delay=0.03, lag=LAG)
    omega = np.array([7.0])
    z = np.exp(1j * omega[0] * TICK)
    n = len(loop.a)
    ratio = np.linalg.det(z * np.eye(n) - loop.closed) / np.linalg.det(z * np.eye(n) - loop.a)
    assert 1.0 + loop_gain(loop, omega)[0] == pytest.approx(ratio, rel=1e-6)
    assert spectral_radius(loop) < 1.0
