"""Exact delay analysis against polynomials, simulation and python-control."""

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from canroll.gain_gen.analysis.delay_system import (
    chebyshev,
    closed_loop_response,
    h_infinity,
    largest_delay,
    rightmost_root,
)
from canroll.gain_gen.models.roll import (
    PERFORMANCE,
    ROLL_RATE,
    disturbance_input,
    moment_input,
    state_matrix,
)
from canroll.vehicles import load


@pytest.fixture(scope="module")
def van():
    return load("van_2021").design


def delayed(van, gain):
    return gain * moment_input(van) @ ROLL_RATE


def test_differentiation_matrix_is_exact_on_polynomials():
    matrix, nodes = chebyshev(12)
    np.testing.assert_allclose(matrix @ nodes**5, 5 * nodes**4, atol=1e-11)


def test_rightmost_root_of_a_scalar_delay_equation():
    """x' = −(π/2) x(t − 1) has its rightmost roots at ± j π/2, exactly."""
    root = rightmost_root(np.zeros((1, 1)), np.array([[-np.pi / 2]]), 1.0)
    assert root.real == pytest.approx(0.0, abs=1e-10)
    assert abs(root.imag) == pytest.approx(np.pi / 2, rel=1e-10)


@settings(max_examples=40, deadline=None)
@given(gain=st.floats(-14000, -200), delay=st.floats(0.005, 0.3))
def test_rightmost_root_fulfils_the_characteristic_equation(gain, delay):
    van = load("van_2021").design
    root = rightmost_root(state_matrix(van), delayed(van, gain), delay)
    residual = (
        van.roll_inertia * root**2
        + (van.roll_damping - gain * np.exp(-root * delay)) * root
        + van.effective_stiffness
    )
    scale = van.roll_inertia * abs(root) ** 2 + abs(gain * root * np.exp(-root * delay))
    assert abs(residual) < 1e-7 * (scale + van.effective_stiffness)
    # no root further right: the argument principle on a large half disc, by winding of det
    assert winding(van, gain, delay, root.real + 0.05 + 1e-3 * abs(root.real)) == 0


def winding(van, gain, delay, edge):
    """Number of roots right of ``edge``, by the winding of I s² + (C − K e^{−sτ}) s + T."""
    radius = 4000.0
    line = edge + 1j * np.concatenate(
        [-np.geomspace(radius, 1e-2, 40000), np.geomspace(1e-2, radius, 40000)]
    )
    arc = edge + radius * np.exp(1j * np.linspace(np.pi / 2, -np.pi / 2, 20000))
    s = np.concatenate([line, arc])
    value = (
        van.roll_inertia * s**2
        + (van.roll_damping - gain * np.exp(-s * delay)) * s
        + van.effective_stiffness
    )
    return round(-np.sum(np.diff(np.unwrap(np.angle(value)))) / (2 * np.pi))


@pytest.mark.parametrize(
    ("gain", "expected"), [(-4816.0, 0.259), (-7400.0, 0.141), (-13552.5, 0.0677)]
)
def test_largest_delay_of_printed_and_exact_gains(van, gain, expected):
    found = largest_delay(state_matrix(van), moment_input(van), gain * ROLL_RATE)
    assert found == pytest.approx(expected, rel=5e-3)
    for factor, stable in ((0.999, True), (1.001, False)):
        root = rightmost_root(state_matrix(van), delayed(van, gain), factor * found)
        assert (root.real < 0.0) == stable


def test_a_gain_below_the_damping_admits_any_delay(van):
    gain = -0.99 * van.roll_damping
    assert largest_delay(state_matrix(van), moment_input(van), gain * ROLL_RATE) == np.inf
    unstable = 1.01 * van.roll_damping
    assert largest_delay(state_matrix(van), moment_input(van), unstable * ROLL_RATE) == 0.0


def test_level_of_the_open_loop_and_of_a_delay_free_loop_agree_with_python_control(van):
    for gain in (0.0, -9550.0):
        a = state_matrix(van) + delayed(van, gain)
        system = control.ss(a, disturbance_input(van), PERFORMANCE, np.zeros((1, 3)))
        grid = np.geomspace(1e-3, 1e3, 20001)
        response = system(1j * grid)
        expected = np.sqrt((np.abs(response[0]) ** 2).sum(axis=0).max())
        found = h_infinity(a, np.zeros((2, 2)), disturbance_input(van), PERFORMANCE, delay=0.0)
        assert found == pytest.approx(expected, rel=1e-5)
    open_loop = h_infinity(
        state_matrix(van), delayed(van, 0.0), disturbance_input(van), PERFORMANCE, delay=0.0
    )
    assert open_loop**2 == pytest.approx(3.192, rel=1e-3)


def test_delay_response_agrees_with_a_high_pade_model(van):
    """python-control's Padé model of order 12 of the same loop, far inside its band."""
    gain, delay = -2871.0, 0.1
    numerator, denominator = control.pade(delay, 12)
    lag = control.tf(numerator, denominator)
    plant = control.tf([1.0, 0.0], [van.roll_inertia, van.roll_damping, van.effective_stiffness])
    lateral = van.roll_arm * control.tf(
        [1.0], [van.roll_inertia, van.roll_damping, van.effective_stiffness]
    )
    closed = lateral / (1 - gain * lag * plant)
    frequencies = np.array([0.5, 2.0, 5.0, 9.0, 20.0])
    expected = closed(1j * frequencies)
    found = closed_loop_response(
        state_matrix(van),
        delayed(van, gain),
        disturbance_input(van)[:, :1],
        np.array([[1.0, 0.0]]),
        delay=delay,
        frequencies=frequencies,
    )[:, 0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_unstable_loop_has_no_level(van):
    level = h_infinity(
        state_matrix(van), delayed(van, -13552.5), disturbance_input(van), PERFORMANCE, delay=0.1
    )
    assert level == np.inf
