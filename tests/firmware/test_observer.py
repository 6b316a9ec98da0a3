"""Observer and prediction against a float64 Kalman filter and an exact simulation."""

import numpy as np
import pytest
import rig
from scipy.linalg import solve_discrete_are

from canroll.firmware import calibration as fw
from canroll.firmware.observer import look_ahead
from canroll.firmware.state import ACTIVE, DEGRADED, GYRO_BIAS, LATERAL, ROLL

UNIT = 2.0 ** -rig.STATE_Q.astype(float)
TICK = 0.01


def measured(bench: rig.Bench) -> tuple[np.ndarray, float]:
    """Roll rate, a_y and delivered moment as the frames carry them."""
    imu, actuators = bench.received["Imu"], bench.received["ActuatorState"]
    y = np.array([np.radians(imu["RollRate"]), imu["LateralAcceleration"]])
    return y, actuators["DeliveredMomentFront"] + actuators["DeliveredMomentRear"]


@pytest.mark.parametrize(("measurements", "rows"), [(1, [0]), (2, [1]), (3, [0, 1])])
@pytest.mark.parametrize("vehicle", [rig.VAN, rig.SUV], ids=["van", "suv"])
def test_constant_gain_is_the_joint_kalman_filter(measurements, rows, vehicle):
    model = rig.observer_model(vehicle, TICK)
    c, r = model.output[rows], np.diag(model.measurement_noise[rows])
    cal = rig.calibration(vehicle, measurements=measurements)
    for m, gains in zip(
        rows, rig.sequential_gains(model.phi, c, model.noise, np.diag(r)), strict=True
    ):
        for i in range(5):
            (cal.correction[m][i],), cal.correction_shift[m][i] = rig.quantise_row(
                [gains[i]], rig.STATE_Q[i], [rig.MEASURED_Q[m]]
            )
    p = solve_discrete_are(model.phi.T, c.T, model.noise, r)
    gain = p @ c.T @ np.linalg.inv(c @ p @ c.T + r)
    bench = rig.Bench(cal, vehicle, noise=(0.003, 0.05), bias=(0.004, 0.0))
    bench.run(0.05)
    x = np.array(bench.ecu.x) * UNIT
    worst = np.zeros(5)
    for _ in range(600):
        bench.step(rig.lane_change(bench.t))
        y, moment = measured(bench)
        x = model.phi @ x + model.gamma * moment
        x = x + gain @ (y[rows] - c @ x)
        worst = np.maximum(worst, np.abs(np.array(bench.ecu.x) * UNIT - x))
    assert bench.ecu.mode == ACTIVE
    # a hundredth of the noise of one sample; what matters in the moment is tested in test_twin
    assert np.all(worst < [1e-6, 1e-6, 1e-5, 1e-4, 1e-6]), worst


def test_two_sensors_find_roll_angle_and_lateral_acceleration_in_spite_of_gyro_bias():
    bench = rig.Bench(rig.calibration(), noise=(0.003, 0.05), bias=(np.radians(0.5), 0.0), seed=3)
    bench.run(60.0, rig.lane_change)
    errors = []
    for _ in range(600):
        ay, truth = rig.lane_change(bench.t), bench.x[0]
        bench.step(ay)
        errors.append([bench.ecu.x[ROLL] * UNIT[ROLL] - truth, bench.ecu.x[LATERAL] * UNIT[2] - ay])
    roll, lateral = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.degrees(roll) < 0.1
    assert lateral < 0.1
    assert np.degrees(bench.ecu.x[GYRO_BIAS] * UNIT[4]) == pytest.approx(0.5, abs=0.1)


def test_gyro_bias_is_limited_to_what_is_believed():
    cal = rig.calibration(bias_max=round(0.002 * 2**27))
    bench = rig.Bench(cal, bias=(0.02, 0.0)).run(20.0)
    assert bench.ecu.x[GYRO_BIAS] == cal.bias_max


def test_bypass_takes_the_true_motion():
    cal = rig.calibration(observer=fw.BYPASS)
    cal.timeout_ticks = [0, 10, 0, 5, 5]
    bench = rig.Bench(cal, reference=True, drop={"Imu"}).active()
    for _ in range(100):
        truth = bench.x.copy()
        bench.step(3.0)
        np.testing.assert_allclose(
            np.array(bench.ecu.x[:3]) * UNIT[:3], [truth[0], truth[1], 3.0], atol=7e-4
        )
    assert bench.ecu.mode == ACTIVE
    assert abs(bench.ecu.moment) > 100 << 14


def exact_prediction(vehicle, x, moment, commands, lag=0.015):
    """Continuous plant, a_y model and lagging actuator under held commands."""
    a = np.zeros((6, 6))
    a[:2, :2] = vehicle.a()
    a[1, 2] = vehicle.moment_per_acceleration / vehicle.inertia
    a[2, 3], a[3, 2], a[3, 3], a[4, 4] = 1.0, -2.25, -2.4, -0.02
    a[1, 5], a[5, 5] = 1 / vehicle.inertia, -1 / lag
    b = np.zeros((6, 1))
    b[5] = 1 / lag
    phi, gamma = rig.hold(a, b, TICK)
    z = np.append(x, moment)
    for command in commands:
        z = phi @ z + gamma[:, 0] * command
    return z[:5]


@pytest.mark.parametrize("vehicle", [rig.VAN, rig.SUV], ids=["van", "suv"])
@pytest.mark.parametrize("steps", [1, 5, 32])
def test_prediction_goes_through_the_commands_under_way(vehicle, steps):
    cal = rig.calibration(vehicle, predict_steps=steps, bias_max=1 << 20)
    ecu = rig.started(cal)
    rng = np.random.default_rng(steps)
    feedback = rig.FEEDBACK + rig.FEEDFORWARD
    worth = []
    for head in (0, 7, 31):
        commands = np.round(np.cumsum(rng.normal(size=32)) * 150 * 2**14) / 2**14
        x = rng.normal(size=5) * [0.03, 0.2, 3.0, 2.0, 0.005]
        moment = commands[32 - steps] + 100.0
        ecu.ring_head = head
        for age, command in enumerate(commands[::-1]):
            ecu.ring[(head - age) % 32] = round(command * 2**14)
        ecu.moment_unknown = 0
        ecu.delivered = [round(moment * 0.4 * 2**14), round(moment * 0.6 * 2**14)]
        ecu.x = [round(v / u) for v, u in zip(x, UNIT, strict=True)]
        # no a_y by steering enters this model's prediction
        ecu.steering_acceleration = 0
        ecu.motion_lost = 0
        look_ahead(ecu, cal)
        ahead = np.array(ecu.ahead) * UNIT
        exact = exact_prediction(vehicle, x, moment, commands[32 - steps :])
        worth.append(feedback @ (ahead - exact))
    assert np.max(np.abs(worth)) < 3.0, worth


def test_the_law_sees_the_state_at_the_instant_its_command_acts():
    """50 ms of delay: the prediction made at k matches the plant five ticks later."""
    delay = 5
    bench = rig.Bench(rig.calibration(predict_steps=delay), delay=delay).active()
    predicted, estimated, truth = [], [], []
    for _ in range(800):
        bench.step(rig.lane_change(bench.t, amplitude=3.0))
        predicted.append(bench.ecu.ahead[0] * UNIT[0])
        estimated.append(bench.ecu.x[0] * UNIT[0])
        truth.append(bench.x[0])
    # after step k the plant has moved on one tick already
    later = np.array(truth[delay - 1 :])
    rms = lambda e: np.degrees(np.sqrt(np.mean(np.square(e))))  # noqa: E731
    ahead_error = rms(np.array(predicted[: len(later)]) - later)
    assert ahead_error < 0.1
    assert ahead_error < 0.25 * rms(np.array(estimated[: len(later)]) - later)


def test_lost_lateral_acceleration_takes_the_one_sensor_gains():
    model = rig.observer_model(rig.VAN, TICK)
    bench = rig.Bench(rig.calibration(), noise=(0.003, 0.05)).active()
    bench.change["Imu"] = {"LateralAcceleration": 40.9575}
    bench.run(0.2)
    assert bench.ecu.mode == DEGRADED
    x = np.array(bench.ecu.x) * UNIT
    for _ in range(200):
        bench.step(rig.lane_change(bench.t))
        y, moment = measured(bench)
        x = model.phi @ x + model.gamma * moment
        x = x + model.single * (y[0] - model.output[0] @ x)
        np.testing.assert_allclose(np.array(bench.ecu.x) * UNIT, x, atol=1e-4)
