"""State feedback, observer and their discretisation against python-control, scipy and the paper."""

import control
import numpy as np
import pytest
from scipy.signal import cont2discrete

from canroll.gain_gen.laws.state_gains import (
    discrete_plant,
    disturbance_feedforward,
    lqr,
    sliding_mode,
    yim_weights,
)
from canroll.gain_gen.models.observer import (
    LateralModel,
    SensorNoise,
    bias_response,
    kalman,
    observable_rank,
    observer_model,
    steady_covariance,
)
from canroll.gain_gen.models.roll import (
    disturbance_input,
    moment_input,
    normalise,
    scaled,
    state_matrix,
    zero_order_hold,
)
from canroll.vehicles import load

TICK = 0.01


@pytest.fixture(scope="module")
def suv():
    return load("suv_2020").design


@pytest.fixture(scope="module")
def van():
    return load("van_2021").design


def test_hold_agrees_with_scipy(van):
    a, b = state_matrix(van), np.hstack([moment_input(van), disturbance_input(van)])
    phi, gamma = zero_order_hold(a, b, TICK)
    expected = cont2discrete((a, b, np.eye(2), np.zeros((2, 4))), TICK)
    np.testing.assert_allclose(phi, expected[0], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(gamma, expected[1], rtol=1e-10, atol=1e-15)


def test_hold_of_nothing_is_identity(van):
    phi, gamma = zero_order_hold(state_matrix(van), moment_input(van), 0.0)
    np.testing.assert_array_equal(phi, np.eye(2))
    np.testing.assert_array_equal(gamma, np.zeros((2, 1)))


def test_normalised_plant_has_the_same_poles_in_its_own_time(van):
    scaled_plant = normalise(van)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(scaled_plant.a) * scaled_plant.frequency),
        np.sort_complex(np.linalg.eigvals(state_matrix(van))),
        rtol=1e-12,
    )
    unit = van.effective_stiffness / van.natural_frequency
    assert scaled_plant.rate_gain(-123.0) == pytest.approx(-123.0 * unit)


def test_scaled_model_moves_only_what_it_names(van):
    changed = scaled(van, damping=1.2)
    assert changed.roll_damping == pytest.approx(1.2 * van.roll_damping)
    assert changed.roll_inertia == van.roll_inertia


def test_lqr_agrees_with_python_control_and_the_tables(suv):
    """Yim 2020, tables 1 and 2: [57668 7132]; the printed gains do not follow from them."""
    weights = yim_weights(suv)
    gain = lqr(suv, TICK, weights)
    phi, gamma, _ = discrete_plant(suv, TICK)
    expected, _, _ = control.dlqr(phi, gamma, weights.state, weights.input)
    np.testing.assert_allclose(gain, expected, rtol=1e-9)
    np.testing.assert_allclose(gain, [[57668, 7132]], rtol=1e-4)


def test_sliding_mode_reaches_its_surface(suv):
    surface = np.array([[10.0, 1.0]])
    gain = sliding_mode(suv, TICK, surface=surface, alpha=0.5)
    np.testing.assert_allclose(gain, [[168831, 19608]], rtol=1e-4)
    phi, gamma, _ = discrete_plant(suv, TICK)
    x = np.array([[0.02], [-0.3]])
    following = (phi - gamma @ gain) @ x
    np.testing.assert_allclose(surface @ following, 0.5 * surface @ x, rtol=1e-12)


@pytest.mark.parametrize("alpha", [0.0, 1.0, -0.5])
def test_sliding_mode_refuses_a_surface_that_does_not_converge(suv, alpha):
    with pytest.raises(ValueError, match="alpha"):
        sliding_mode(suv, TICK, surface=np.array([[10.0, 1.0]]), alpha=alpha)


def test_feedforward_is_the_roll_arm_in_every_discretisation(suv):
    assert disturbance_feedforward(suv, TICK) == pytest.approx(442.8, rel=1e-9)
    assert disturbance_feedforward(suv, 0.002) == pytest.approx(442.8, rel=1e-9)


def test_sequential_gains_equal_the_joint_kalman_gain(van):
    """python-control's dlqe solves the joint problem; scalar corrections must add up to it."""
    model = observer_model(van, TICK, lateral=LateralModel(), noise=SensorNoise())
    observer = kalman(model)
    # dlqe wants a well-scaled problem: states in units of their own process noise
    unit = np.sqrt(np.diag(model.process_noise))
    phi = model.phi * unit[None, :] / unit[:, None]
    process = model.process_noise / np.outer(unit, unit)
    joint, covariance, _ = control.dlqe(
        phi, np.eye(5), model.output * unit, process, np.diag(model.measurement_noise)
    )
    np.testing.assert_allclose(
        steady_covariance(model, (0, 1)) / np.outer(unit, unit), covariance, rtol=1e-6, atol=1e-9
    )
    joint = joint * unit[:, None]
    sequential = np.stack(
        [
            (np.eye(5) - np.outer(observer.correction[1], model.output[1]))
            @ observer.correction[0],
            observer.correction[1],
        ],
        axis=1,
    )
    # dlqe gives the gain of the one-step predictor, A times that of the filter
    np.testing.assert_allclose(model.phi @ sequential, joint, rtol=1e-5, atol=1e-8)


def test_roll_rate_alone_does_not_observe_roll_and_acceleration(suv):
    """Yim 2020, (31): direction [m h / T, 0, 1] is invisible, exactly."""
    model = observer_model(suv, TICK, lateral=LateralModel(frequency=0.0), noise=SensorNoise())
    states = [0, 1, 2]
    phi = model.phi[np.ix_(states, states)]
    assert observable_rank(phi, np.array([[0.0, 1.0, 0.0]])) == 2
    invisible = np.array([suv.roll_arm / suv.effective_stiffness, 0.0, 1.0])
    np.testing.assert_allclose(phi @ invisible, invisible, atol=1e-12)
    assert observable_rank(model.phi, model.output) == 4
    full = observer_model(suv, TICK, lateral=LateralModel(), noise=SensorNoise())
    assert observable_rank(full.phi, full.output) == 5


def test_one_sensor_filter_drifts_by_the_gyro_bias_and_says_so(suv):
    """0.1 deg/s of bias puts the estimate 60 degrees off in ten minutes."""
    model = observer_model(suv, TICK, lateral=LateralModel(frequency=0.0), noise=SensorNoise())
    observer = kalman(model, measurements=(0,))
    angle = bias_response(model, observer.correction_single, bias=np.radians(0.1), seconds=600.0)
    assert abs(np.degrees(angle)) == pytest.approx(60.0, rel=0.05)
    assert "not observable" in observer.warnings[0]
    assert "after 10 min" in observer.warnings[0]
    assert kalman(model).warnings == ()


@pytest.mark.parametrize("tick", [0.01, 0.02])
def test_the_drift_of_a_filter_is_taken_after_the_seconds_asked_for(suv, tick):
    """Roll rate from a bias: the filter's own recursion over exactly ten minutes of ticks."""
    model = observer_model(suv, tick, lateral=LateralModel(frequency=0.0), noise=SensorNoise())
    gain = kalman(model, measurements=(0,)).correction_single
    phi = model.phi.copy()
    phi[4] = 0.0
    x = np.zeros(5)
    for _ in range(round(600.0 / tick)):
        x = phi @ x
        x = x + gain * (np.radians(0.1) - x[1])
    found = bias_response(model, gain, bias=np.radians(0.1), seconds=600.0)
    assert found == pytest.approx(x[0], rel=1e-6)
