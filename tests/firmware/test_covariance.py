"""The run-time Riccati recursion against float64, through dropouts and over minutes."""

import numpy as np
import pytest
import rig
from scipy.linalg import solve_discrete_are

from canroll.firmware import calibration as fw
from canroll.firmware import ecu as loop
from canroll.firmware.covariance import bounded, propagate, update
from canroll.firmware.state import ACTIVE, DEGRADED

TICK = 0.01
S = rig.covariance_units()
UNIT = 2.0 ** -rig.STATE_Q.astype(float)


def covariance(ecu) -> np.ndarray:
    return np.array(ecu.covariance) * 2.0**-24 * np.outer(S, S)


class Riccati:
    """P of the sequential filter in float64; variances capped as the calibration says."""

    def __init__(self, model: rig.Model, cap: float = np.inf) -> None:
        self.model, self.cap = model, cap
        self.p = np.diag(S**2)

    def propagate(self) -> None:
        self.p = self.model.phi @ self.p @ self.model.phi.T + self.model.noise
        for i in range(5):
            excess = self.cap * S[i] ** 2 / self.p[i, i]
            if excess < 1.0:
                self.p[i, :] *= excess
                self.p[:, i] *= excess
                self.p[i, i] /= excess

    def update(self, m: int) -> np.ndarray:
        c, r = self.model.output[m], self.model.measurement_noise[m]
        gain = self.p @ c / (c @ self.p @ c + r)
        self.p = self.p - np.outer(gain, c @ self.p)
        return gain


def run(cal, measurements, ticks: int, riccati: Riccati, ecu=None):
    """Both recursions side by side; the worst error of a standard deviation, relative."""
    ecu = ecu or rig.started(cal)
    worst = 0.0
    for k in range(ticks):
        propagate(ecu, cal, 1)
        riccati.propagate()
        for m in measurements(k):
            update(ecu, cal, m, 0)
            riccati.update(m)
        if k % 50 == 49:
            ours = np.sqrt(np.diag(covariance(ecu)))
            worst = max(worst, np.max(np.abs(ours / np.sqrt(np.diag(riccati.p)) - 1)))
    return ecu, worst


def test_it_settles_where_the_algebraic_equation_says():
    model = rig.observer_model(rig.VAN, TICK)
    cal = rig.calibration(observer=fw.PROPAGATED_COVARIANCE)
    ecu, _ = run(cal, lambda k: (0, 1), 3000, Riccati(model))
    p = solve_discrete_are(
        model.phi.T, model.output[:2].T, model.noise, np.diag(model.measurement_noise)
    )
    gain = (
        p
        @ model.output[:2].T
        @ np.linalg.inv(
            model.output[:2] @ p @ model.output[:2].T + np.diag(model.measurement_noise)
        )
    )
    posterior = p - gain @ model.output[:2] @ p
    ours = np.sqrt(np.diag(covariance(ecu)))
    np.testing.assert_allclose(ours, np.sqrt(np.diag(posterior)), rtol=0.03)


def dropouts(k: int) -> tuple[int, ...]:
    """The gyro every tick, a_y away for two seconds of every five, all away for a while."""
    if 900 < k < 940:
        return ()
    return (0,) if k % 500 > 300 else (0, 1)


@pytest.mark.parametrize("vehicle", [rig.VAN, rig.SUV], ids=["van", "suv"])
def test_it_follows_the_float_recursion_through_dropouts(vehicle):
    model = rig.observer_model(vehicle, TICK)
    cal = rig.calibration(vehicle, observer=fw.PROPAGATED_COVARIANCE)
    _, worst = run(cal, dropouts, 3000, Riccati(model, cap=30.0))
    assert worst < 0.05


@pytest.mark.slow
def test_it_follows_the_float_recursion_for_ten_minutes():
    model = rig.observer_model(rig.VAN, TICK)
    cal = rig.calibration(observer=fw.PROPAGATED_COVARIANCE)
    _, worst = run(cal, dropouts, 60_000, Riccati(model, cap=30.0))
    assert worst < 0.05


def test_it_stays_positive_where_the_cap_binds():
    """One sensor only and a low cap: roll angle and a_y can't be told apart."""
    cal = rig.calibration(observer=fw.PROPAGATED_COVARIANCE)
    model = rig.observer_model(rig.VAN, TICK)
    rig.fill_covariance(cal, model, cap=0.5)
    ecu = rig.started(cal)
    for _ in range(3000):
        propagate(ecu, cal, 1)
        update(ecu, cal, 0, 0)
        assert all(0 < ecu.covariance[i][i] <= cal.covariance_max[i] for i in range(5))
    eigenvalues = np.linalg.eigvalsh(np.array(ecu.covariance) * 2.0**-24)
    assert eigenvalues.min() > -1e-5


def test_its_estimate_is_the_time_varying_kalman_filter():
    model = rig.observer_model(rig.VAN, TICK)
    cal = rig.calibration(observer=fw.PROPAGATED_COVARIANCE)
    bench = rig.Bench(cal, noise=(0.003, 0.05), bias=(0.005, 0.0))
    riccati = Riccati(model, cap=30.0)
    x = np.zeros(5)
    first = True
    for k in range(700):
        if k == 400:
            bench.change["Imu"] = {"LateralAcceleration": 40.9575}
        bench.step(rig.lane_change(bench.t))
        imu, actuators = bench.received["Imu"], bench.received["ActuatorState"]
        moment = actuators["DeliveredMomentFront"] + actuators["DeliveredMomentRear"]
        # the first frame of an E2E sender only tells its counter
        x = model.phi @ x + model.gamma * (0.0 if first else moment)
        riccati.propagate()
        if not first:
            y = [np.radians(imu["RollRate"]), imu["LateralAcceleration"]]
            for m in (0, 1) if k < 400 else (0,):
                innovation = y[m] - model.output[m] @ x
                x = x + riccati.update(m) * innovation
        first = False
        error = np.abs(np.array(bench.ecu.x) * UNIT - x)
        assert np.all(error < [2e-4, 4e-4, 0.01, 0.02, 1e-4]), (k, error)
    assert bench.ecu.mode == DEGRADED
    assert bench.ecu.fault_latched == 1 << 7


def test_it_starts_as_calibrated():
    cal = rig.calibration(observer=fw.PROPAGATED_COVARIANCE, covariance_start=[5, 6, 7, 8, 9])
    ecu = rig.started(cal)
    ecu.covariance[1][2] = 99
    assert loop.init(ecu, cal) == 0
    assert ecu.covariance == np.diag([5, 6, 7, 8, 9]).tolist()
    assert rig.Bench(cal).active().ecu.mode == ACTIVE


def test_a_capped_variance_takes_its_covariances_down_by_the_same_factor():
    cal = rig.calibration(observer=fw.PROPAGATED_COVARIANCE)
    cal.covariance_max = [1 << 24, *[1 << 29] * 4]
    ecu = rig.started(cal)
    ecu.covariance = (np.diag([4 << 24] * 5) + 0).tolist()
    ecu.covariance[0][1] = ecu.covariance[1][0] = 1 << 22
    bounded(ecu, cal)
    assert ecu.covariance[0][0] == 1 << 24
    assert ecu.covariance[0][1] == ecu.covariance[1][0] == 1 << 20
    assert ecu.covariance[1][1] == 4 << 24
