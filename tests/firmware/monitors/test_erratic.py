"""Erratic sensors: jumps and noise beyond what a car and its sensors make."""

from collections.abc import Sequence

import numpy as np
import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.monitors.samples import watch_samples
from canroll.firmware.plausibility import FAULT_SENSOR_ERRATIC
from canroll.firmware.state import RX_IMU, RX_VEHICLE_MOTION, Ecu

BIT = 1 << FAULT_SENSOR_ERRATIC
# message, name, bit of ecu.valid, format, largest second difference (SI units)
SIGNALS = [
    (RX_IMU, "roll_rate", 1, fw.Q_RATE, 0.25),
    (RX_IMU, "lateral_acceleration", 2, fw.Q_ACCELERATION, 4.0),
    (RX_IMU, "yaw_rate", 4, fw.Q_RATE, 0.09),
    (RX_VEHICLE_MOTION, "speed", 1, fw.Q_SPEED, 1.0),
    (RX_VEHICLE_MOTION, "steering", 2, 24, 0.7),
]
NAMES = [name for _, name, _, _, _ in SIGNALS]


def watched(**changes) -> fw.Calibration:
    """A calibration with the monitor on, one sample of either message a tick."""
    scale = [round(2.0 ** (42 - q) / most) for _, _, _, q, most in SIGNALS]
    given = {"erratic_scale": scale, "erratic_gap": [1, 1], "erratic_samples": [1, 1]}
    return rig.calibration(**{**given, **changes})


class Sensor:
    """Samples of one signal, in units of its largest second difference."""

    def __init__(self, k: int, cal: fw.Calibration) -> None:
        self.message, self.name, self.bit, self.q, self.most = SIGNALS[k]
        self.k, self.cal, self.ecu, self.count = k, cal, rig.started(cal), 0

    def send(self, value: float, *, step: int = 1, elapsed: int = 1, valid: bool = True) -> bool:
        """Give a sample after ``elapsed`` ticks; return whether it is reported."""
        ecu: Ecu = self.ecu
        self.count += step
        ecu.fresh[RX_IMU] = ecu.fresh[RX_VEHICLE_MOTION] = 0
        ecu.fresh[self.message] = RX_SIGNALS[self.message]
        ecu.valid[self.message] = self.bit if valid else 0
        counter = "imu_sample" if self.message == RX_IMU else "motion_sample"
        setattr(ecu, counter, self.count % 16)
        if valid:
            setattr(ecu, self.name, round(value * self.most * 2**self.q))
        ecu.detected = 0
        watch_samples(ecu, self.cal, elapsed)
        assert ecu.detected in (0, BIT)
        return ecu.detected == BIT

    def all(self, values: Sequence[float]) -> list[bool]:
        """Give samples in a row."""
        return [self.send(float(value)) for value in values]


@pytest.fixture(params=range(len(SIGNALS)), ids=NAMES)
def sensor(request) -> Sensor:
    """Each of the signals."""
    return Sensor(request.param, watched())


@pytest.mark.parametrize(("jump", "found"), [(0.65, False), (0.75, True), (-0.75, True)])
def test_a_jump_is_found_within_two_samples(sensor, jump, found):
    """A jump bends twice, there and back: both squares exceed one from 0.73 of the limit on."""
    assert not any(sensor.all([1.0] * 20))
    reported = sensor.all([1.0 + jump] * 60)
    assert any(reported) == found
    if found:
        assert reported.index(True) == 1
        assert not any(reported[5:])


def test_noise_is_found_and_the_report_fades(sensor):
    random = np.random.default_rng(1)
    assert not any(sensor.all(random.normal(0.0, 0.06, 400)))
    noisy = sensor.all(random.normal(0.0, 0.5, 40))
    assert noisy.index(True) <= 8 and sum(noisy[8:]) > 25
    # 4 units at most, of which an eighth fades a sample
    assert not any(sensor.all(random.normal(0.0, 0.05, 120))[60:])


def test_a_steady_change_is_not_erratic_however_fast(sensor):
    ramp = np.arange(20) * 0.9
    assert not any(sensor.all([0.0] * 5 + list(ramp))[:6])
    assert not any(sensor.all(ramp[-1] + 0.9 + np.arange(20) * 0.9))


@pytest.mark.parametrize("broken", ["a sample is missing", "it came late", "no value"])
def test_missing_samples_and_values_start_anew(sensor, broken):
    """What comes after a gap is compared with nothing before it."""
    assert not any(sensor.all([0.0] * 6))
    if broken == "a sample is missing":
        assert not sensor.send(3.0, step=2)
    elif broken == "it came late":
        assert not sensor.send(3.0, elapsed=2)
    else:
        assert not sensor.send(0.0, valid=False)
    assert not any(sensor.all([3.0] * 6))
    assert sensor.send(0.0)


def test_a_message_that_is_late_does_not_start_the_other_anew():
    imu = Sensor(0, watched())
    assert not any(imu.all([0.0] * 6))
    imu.ecu.sample_gap[1] = 200
    assert any(imu.all([1.5] * 2))


def test_a_scale_of_zero_judges_nothing(sensor):
    sensor.cal = watched(erratic_scale=[0] * 5)
    assert not any(sensor.all([0.0, 9.0] * 20))


def test_the_sum_is_that_of_the_squared_second_differences(sensor):
    """Compared with the sum in float64."""
    values = np.random.default_rng(2).normal(0.0, 0.2, 200)
    expected = 0.0
    for place, value in enumerate(values):
        sensor.send(float(value))
        expected *= 7 / 8
        if place >= 2:
            expected += min(abs(value - 2 * values[place - 1] + values[place - 2]), 4) ** 2
        assert sensor.ecu.erratic_sum[sensor.k] / 4096 == pytest.approx(expected, abs=5e-3)


def test_a_wild_sample_counts_as_sixteen(sensor):
    sensor.all([0.0] * 5)
    sensor.send(6.0)
    assert sensor.ecu.erratic_sum[sensor.k] == 16 << 12
