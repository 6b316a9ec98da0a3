"""The full-car law: balancing against python-control, orders in the loop, the ideal law."""

import control
import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.firmware.calibration import Q_MOMENT
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.design import design
from canroll.gain_gen.laws.compensator import COMPENSATOR_SIGMA, checked, scaled_states
from canroll.gain_gen.laws.lqr_full_car import closed_loop, rolling, sampled_car
from canroll.gain_gen.models.controller import Compensator
from canroll.gain_gen.models.full_car import (
    CURRENTS,
    INPUTS,
    ROLL,
    SPEED,
    STEER,
    car_of,
    full_car_model,
    ideal_gain,
    reduction_db,
    weights,
)
from canroll.gain_gen.models.roll import stationary_covariance, zero_order_hold
from canroll.gain_gen.models.state_space import StateSpace
from canroll.gain_gen.models.task import Delay, Task
from canroll.plant_sim.bodies import linear_car, ports
from canroll.plant_sim.world.linearise import IMU_LATERAL_ACCELERATION, find_trim, linearise
from canroll.vehicles import load
from canroll.vehicles.full_car import AS_PRINTED, REPAIRED


def task(vehicle="car_2020", **options):
    return Task(load(vehicle), Delay(0.014, 0.006, 0.023), actuator="valves", **options)


@pytest.fixture(scope="module")
def answer():
    return design("lqr_full_car", task())


def random_system(seed, n=8):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    a *= 0.9 / np.abs(np.linalg.eigvals(a)).max()
    return a, rng.normal(size=(n, 2)), rng.normal(size=(2, n))


@pytest.mark.parametrize("seed", range(4))
def test_balanced_coordinates_have_equal_diagonal_gramians(seed):
    a, b, c = random_system(seed)
    even, values = StateSpace(a, b, c, np.zeros((2, 2)), 1.0).balanced()
    reach = stationary_covariance(even.a, even.b @ even.b.T)
    observe = stationary_covariance(even.a.T, even.c.T @ even.c)
    np.testing.assert_allclose(reach, np.diag(values), atol=1e-6 * values[0])
    np.testing.assert_allclose(observe, np.diag(values), atol=1e-6 * values[0])
    expected = np.sqrt(
        np.linalg.eigvals(control.dlyap(a, b @ b.T) @ control.dlyap(a.T, c.T @ c)).real
    )
    np.testing.assert_allclose(values, np.sort(expected)[::-1], rtol=1e-6)


def test_truncation_keeps_within_twice_the_tail():
    """Glover's bound: the error is at most twice the sum of the values left out."""
    a, b, c = random_system(7)
    even, values = StateSpace(a, b, c, np.zeros((2, 2)), 1.0).balanced()
    angles = np.linspace(0.0, np.pi, 400)
    errors = StateSpace(a, b, c, np.zeros((2, 2)), 1.0).response(angles)
    errors -= even.truncated(4).response(angles)
    worst = np.linalg.norm(errors, 2, axis=(1, 2)).max()
    assert worst <= 2.0 * values[4:].sum() * (1 + 1e-6)
    assert worst > 0.0
    with pytest.raises(ValueError, match="stable"):
        StateSpace(1.01 * np.eye(1), *[np.eye(1)] * 3, 1.0).balanced()


def test_stationary_covariance_agrees_with_python_control_near_the_edge():
    a = np.diag([0.9999, 0.5]) + np.array([[0.0, 0.3], [0.0, 0.0]])
    noise = np.array([[1.0, 0.2], [0.2, 2.0]])
    np.testing.assert_allclose(stationary_covariance(a, noise), control.dlyap(a, noise), rtol=1e-9)


def test_ideal_gain_solves_the_riccati_equation():
    """python-control on the same balanced matrices; the printed units would not move a thing."""
    model = full_car_model(REPAIRED, SPEED)
    gain, b = ideal_gain(model)
    expected, _, _ = control.lqr(model.a, b, np.diag(weights()), 1e3 * np.eye(2))
    np.testing.assert_allclose(gain, expected, rtol=1e-4, atol=1e-4 * np.abs(gain).max())
    assert np.linalg.eigvals(model.a - b @ gain).real.max() < 0.0
    np.testing.assert_array_equal(b, model.b[:, CURRENTS])


def test_heave_and_pitch_are_out_of_reach_of_the_bars():
    model = full_car_model(REPAIRED, SPEED)
    gain, _ = ideal_gain(model)
    assert np.abs(gain[:, :2]).max() < 1e-9 * np.abs(gain).max()


def test_what_the_paper_prints_needs_feedback_on_the_road():
    """Table 3: 28 dB less wheel motion. With bars alone it is one; on the roads it is twenty."""
    printed = full_car_model(AS_PRINTED, SPEED)
    bars, b = ideal_gain(printed, input_weight=1.0)
    hop = 3
    assert abs(reduction_db(printed, printed.a - b @ bars, hop)) < 2.0
    roads, b = ideal_gain(printed, input_weight=1.0, roads=True)
    assert reduction_db(printed, printed.a - b @ roads, hop) > 15.0


def test_compensator_keeps_the_benefit_of_the_full_state(answer):
    """From the inertial sensors alone, at most eight states, at least 85 % of the benefit."""
    compensator = answer.controller.compensator
    assert len(compensator.a) <= 6
    assert answer.solution.extra["benefit_order_6"] > 0.9
    np.testing.assert_array_equal(compensator.b[:, [0, 3]], 0.0)
    assert answer.is_verified


def test_closed_loop_matrix_is_what_a_step_by_step_simulation_does(answer):
    """Steering step through the sampled car, delay line and the ECU's own step."""
    from canroll.gain_gen.models.controller import step

    car = sampled_car(full_car_model(REPAIRED, SPEED), 0.01)
    controller = answer.controller
    a, _ = closed_loop(car, controller, 0.02)
    x = np.zeros(len(a))
    x[26] = 0.02
    plant = x[:27].copy()
    state = np.zeros(controller.order)
    line = [np.zeros(2), np.zeros(2)]
    for _ in range(150):
        state, u = step(controller, state, car.outputs @ plant)
        line.append(u / 1e3)
        plant = car.phi @ plant + car.gamma @ line.pop(0)
        x = a @ x
        np.testing.assert_allclose(x[:27], plant, rtol=1e-7, atol=1e-10)
    assert abs(plant[ROLL]) > 1e-6


def test_more_delay_than_it_admits_shows(answer):
    car = sampled_car(full_car_model(REPAIRED, SPEED), 0.01)
    a, noise = closed_loop(car, answer.controller, 0.02)
    near = rolling(a, noise, car.outputs[2])
    passive = rolling(car.phi, car.noise, car.outputs[2])
    assert near < 0.6 * passive
    late, noise = closed_loop(car, answer.controller, 0.5)
    assert rolling(late, noise, car.outputs[2]) > near


def test_currents_are_limited_in_milliampere(answer):
    record, tables = calibrate(answer)
    assert record.compensator_outputs == 2
    assert record.moment_max / 2**Q_MOMENT == pytest.approx(1e4)
    assert record.current_max / 2**Q_MOMENT == pytest.approx(1e4)
    assert tables["verification"]["quantised_moment_nm"]["value"] < 0.1


def test_only_valves_take_currents():
    with pytest.raises(CanrollError, match="--actuator valves"):
        design("lqr_full_car", Task(load("car_2020"), Delay.constant(0.02)))


def test_scaling_of_an_unstable_compensator_keeps_it_the_same():
    plain = Compensator(
        a=np.array([[1.02]]),
        b=np.array([[0.0, 1e-4, 0.0, 0.0]]),
        e=np.array([[0.0]]),
        c=np.array([[1e6]]),
        d=np.zeros((1, 4)),
    )
    scaled = scaled_states(plain, 0.01)
    np.testing.assert_allclose(scaled.c @ scaled.b, plain.c @ plain.b)
    assert scaled.b[0, 1] != plain.b[0, 1]
    np.testing.assert_array_equal(scaled.a, plain.a)
    with pytest.raises(CanrollError, match="order 9"):
        checked(
            Compensator(
                a=np.eye(9), b=np.zeros((9, 4)), e=np.zeros((9, 1)), c=np.zeros((1, 9)),
                d=np.zeros((1, 4)),
            )
        )  # fmt: skip


def lag(corner, tick):
    """Return a low-pass of the roll rate, rad/s, or an integrator at zero, held over the tick."""
    phi, gamma = zero_order_hold(np.array([[-corner]]), np.ones((1, 1)), tick)
    return Compensator(
        a=phi, b=gamma * [0.0, 1.0, 0.0, 0.0], e=np.zeros((1, 1)), c=np.ones((1, 1)),
        d=np.zeros((1, 4)),
    )  # fmt: skip


@pytest.mark.parametrize("tick", [0.001, 0.01, 0.02])
def test_states_are_sized_by_noise_of_half_a_second_at_every_tick(tick):
    """A low-pass behind a low-pass of half a second: σ √(T₁ / (T₁ + T₂))."""
    size = COMPENSATOR_SIGMA * scaled_states(lag(1.0, tick), tick).c[0, 0]
    assert size == pytest.approx(0.3 * np.sqrt(0.5 / (0.5 + 1.0)), rel=0.02)
    # the same noise integrated for t = 5 s from rest: σ² T (2 t − 3 T), but for e^{−t/T}
    size = COMPENSATOR_SIGMA * scaled_states(lag(0.0, tick), tick).c[0, 0]
    assert size == pytest.approx(0.3 * np.sqrt(0.5 * (2.0 * 5.0 - 3.0 * 0.5)), rel=0.02)


def test_steering_reaches_the_accelerometer_at_once():
    model = full_car_model(REPAIRED, SPEED)
    assert model.steer[1] > 0.0
    steady = -np.linalg.solve(model.a, model.b[:, STEER])
    # a left turn: the left side lifts, the accelerometer reads to the left
    assert steady[ROLL] > 0.0
    assert model.outputs[1] @ steady + model.steer[1] > 0.0


@pytest.mark.parametrize("name", ["van_2022", "van_real", "sedan_320i"])
def test_measured_outputs_are_those_of_the_plant(name):
    """The hydraulic body's step, linearised numerically, read where its inertial unit is."""
    vehicle = load(name)
    frequency = np.array([0.5, 1.0, 2.0])
    plant = linearise(find_trim(vehicle, linear_car.HYDRAULIC_BODY, speed=SPEED))
    model = full_car_model(car_of(vehicle), SPEED, vehicle.sensors.imu_position)
    for slot, column in (
        (ports.STEER, STEER),
        (ports.VALVE_CURRENT_FRONT, CURRENTS[0]),
        (ports.VALVE_CURRENT_REAR, CURRENTS[1]),
    ):
        expected = plant.response(
            frequency,
            np.eye(ports.N_INPUTS)[slot],
            (ports.ROLL_RATE, IMU_LATERAL_ACCELERATION, ports.ROLL),
        )
        feedthrough = model.steer[:3, None] if column == STEER else np.zeros((3, 1))
        car = StateSpace(model.a, model.b[:, [column]], model.outputs[:3], feedthrough)
        response = car.response(2.0 * np.pi * frequency)[:, :, 0].T
        np.testing.assert_allclose(response, expected, rtol=1e-3, err_msg=INPUTS[column])
