"""The observer from the lateral acceleration alone, against scipy and the theory."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.firmware import calibration as fw
from canroll.firmware.covariance import init_covariance, propagate, update
from canroll.firmware.state import Ecu
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.calibration.rows import Q_STATE
from canroll.gain_gen.design import design
from canroll.gain_gen.laws.state_feedback import STEERED, observer_of, sensor_noise
from canroll.gain_gen.models.controller import matrices
from canroll.gain_gen.models.observer import (
    BIAS,
    JERK,
    LateralModel,
    ObserverModel,
    SensorNoise,
    kalman,
    observable_rank,
    observer_model,
)
from canroll.gain_gen.models.task import Delay, Task

TICK = 0.01
LATERAL_ALONE = (1,)
LATERALS = {
    "second order": LateralModel(),
    "random walk": LateralModel(frequency=0.0),
    "steered": STEERED,
}
DELAYS = {"500k": Delay(0.0144, 0.0056, 0.0231), "gateway_20ms": Delay(0.0331, 0.0161, 0.0502)}


def states_of(lateral: LateralModel) -> list[int]:
    """Roll, roll rate, a_y and, of a model that has one, its rate."""
    return [0, 1, 2, JERK] if lateral.frequency > 0.0 else [0, 1, 2]


def model_of(vehicle: str, lateral: LateralModel) -> ObserverModel:
    return observer_model(vehicles.load(vehicle).design, TICK, lateral=lateral, noise=SensorNoise())


def riccati_gain(model: ObserverModel, states: list[int]) -> np.ndarray:
    """Steady Kalman gain of ``states`` from the lateral acceleration, by scipy."""
    kept = np.ix_(states, states)
    h, variance = model.output[1, states], model.measurement_noise[1]
    covariance = solve_discrete_are(
        model.phi[kept].T, h[:, None], model.process_noise[kept], np.array([[variance]])
    )
    return covariance @ h / (h @ covariance @ h + variance)


def task_of(**changes) -> Task:
    vehicle = vehicles.load("van_real")
    known = {"delay": DELAYS["500k"], "noise": sensor_noise(vehicle), "observer": "acceleration"}
    return Task(vehicle, **(known | changes))


@pytest.mark.parametrize("lateral", LATERALS.values(), ids=LATERALS)
@pytest.mark.parametrize("vehicle", ["van_real", "suv_2020"])
def test_its_gain_is_that_of_the_riccati_equation_without_the_gyro_bias(vehicle, lateral):
    model, states = model_of(vehicle, lateral), states_of(lateral)
    observer = kalman(model, measurements=LATERAL_ALONE)
    assert observer.measurements == LATERAL_ALONE
    np.testing.assert_allclose(
        observer.correction[1, states], riccati_gain(model, states), rtol=1e-5
    )
    dropped = [i for i in range(5) if i not in states]
    assert not observer.correction[1, dropped].any()
    assert not observer.correction[0].any()
    assert not observer.model.phi[BIAS].any()


@pytest.mark.parametrize("lateral", LATERALS.values(), ids=LATERALS)
@pytest.mark.parametrize("vehicle", ["van_real", "suv_2020"])
def test_the_lateral_acceleration_alone_observes_all_but_the_gyro_bias(vehicle, lateral):
    model, states = model_of(vehicle, lateral), states_of(lateral)
    lateral_row = model.output[1:2]
    kept = np.ix_(states, states)
    assert observable_rank(model.phi[kept], lateral_row[:, states]) == len(states)
    with_bias = [*states, BIAS]
    kept = np.ix_(with_bias, with_bias)
    assert observable_rank(model.phi[kept], lateral_row[:, with_bias]) == len(states)
    assert model.phi[BIAS, BIAS] == 1.0


def test_steering_changes_the_estimate_but_not_what_is_observed():
    told, alone = (
        model_of("van_real", replace(STEERED, steered=steered)) for steered in (True, False)
    )
    assert told.gamma_steering.any() and not alone.gamma_steering.any()
    np.testing.assert_array_equal(told.phi, alone.phi)
    np.testing.assert_array_equal(told.output, alone.output)


@pytest.mark.parametrize("bus", DELAYS)
@pytest.mark.parametrize("law", ["lqr", "smc", "rate_feedforward", "plain_feedforward"])
def test_a_law_on_it_is_verified_on_every_car_of_the_family(law, bus):
    answer = design(law, task_of(delay=DELAYS[bus]))
    assert answer.is_verified
    assert answer.verified["roll_rms_ratio_nominal_delay"].value < 0.8
    _, from_measured, _, direct = matrices(answer.controller)
    assert not from_measured[:, 0].any() and not direct[:, 0].any()
    record, tables = calibrate(answer)
    assert record.measurements == 2
    assert record.observer == fw.CONSTANT_GAIN
    assert tables["verification"]["quantised_moment_nm"]["ok"]


def test_the_recursion_in_the_ecu_ends_at_the_gain_of_its_riccati_equation():
    """Of the process noise the recursion has the diagonal alone."""
    answer = design("lqr", task_of(observer="acceleration_propagated"))
    record, _ = calibrate(answer)
    assert (record.observer, record.measurements) == (fw.PROPAGATED_COVARIANCE, 2)
    ecu = Ecu()
    init_covariance(ecu, record)
    innovation = 1 << fw.Q_ACCELERATION
    for _ in range(3000):
        propagate(ecu, record, 1)
        ecu.x = [0] * 5
        update(ecu, record, 1, innovation)
    gain = np.array(ecu.x) * 2.0 ** -np.array(Q_STATE, dtype=float)
    model = answer.controller.observer.model
    diagonal = replace(model, process_noise=np.diag(np.diag(model.process_noise)))
    expected = riccati_gain(diagonal, [0, 1, 2, JERK])
    # of a gain that is nearly zero (roll), what counts is its share of the covariance's unit
    np.testing.assert_allclose(gain[:BIAS], expected, rtol=1e-3, atol=1e-6)
    assert ecu.x[BIAS] == 0


@pytest.mark.parametrize(
    ("law", "changes"),
    [
        ("steering_lead", {}),
        ("lqg_delay", {}),
        ("hinf", {}),
        ("hinf_nodelay", {"gains": "as_printed"}),
        ("hinf_delay", {}),
        ("lqr_full_car", {"actuator": "valves"}),
    ],
)
def test_a_law_that_reads_the_measured_roll_rate_is_refused(law, changes):
    with pytest.raises(CanrollError) as caught:
        design(law, task_of(**changes))
    assert str(caught.value) == (
        f"--observer acceleration: {law} reads the measured roll rate, which this observer does "
        "without; choose a law on the observed state such as lqr"
    )


def test_a_law_that_reads_neither_roll_rate_nor_observer_needs_no_roll_rate(tmp_path):
    path = tmp_path / "law.toml"
    path.write_text("A = [[0.8]]\nB = [[0, 0, 0.2, 0]]\nC = [[-120.0]]\nD = [[0, 0, 0, 0]]\n")
    answer = design("custom", task_of(matrices=str(path)))
    assert not answer.controller.observes
    assert calibrate(answer)[0].measurements == 2


def test_the_estimate_is_exact_where_the_model_is():
    """No noise, an a_y of the model's own: the error of the estimate fades."""
    observer = observer_of(task_of())
    model, x, estimate = observer.model, np.array([0.02, 0.1, 3.0, -2.0, 0.0]), np.zeros(5)
    for _ in range(600):
        x, estimate = model.phi @ x, model.phi @ estimate
        estimate = estimate + observer.correction[1] * (model.output[1] @ (x - estimate))
    assert np.abs(x - estimate)[:2].max() < 1e-6
