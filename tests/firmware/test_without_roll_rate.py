"""The loop of a car whose bus carries no roll rate: what it does without it, and what ends it."""

import numpy as np
import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import plausibility as sv
from canroll.firmware.state import ACTIVE, GYRO_BIAS, ROLL, SAFE

TICK = 0.01
NO_ROLL_RATE = {"RollRate": 163.83}
"""The code for error."""
UNITS = 2.0 ** -rig.STATE_Q.astype(float)


def calibration(**changes) -> fw.Calibration:
    """State feedback on an observer from the lateral acceleration alone."""
    model = rig.observer_model(rig.VAN, TICK)
    cal = rig.calibration(measurements=2, **changes)
    kept = np.ix_(range(4), range(4))
    (gains,) = rig.sequential_gains(
        model.phi[kept], model.output[1:2, :4], model.noise[kept], model.measurement_noise[1:]
    )
    cal.correction[1] = [0] * 5
    for i, gain in enumerate(gains):
        (cal.correction[1][i],), cal.correction_shift[1][i] = rig.quantise_row(
            [gain], rig.STATE_Q[i], [rig.MEASURED_Q[1]]
        )
    return cal


def without(**options) -> rig.Bench:
    cal = options.pop("cal", None) or calibration()
    bench = rig.Bench(cal, **options)
    bench.change["Imu"] = NO_ROLL_RATE
    return bench


def commands(bench: rig.Bench, seconds: float) -> list[tuple[int, ...]]:
    found = []
    for _ in range(round(seconds / TICK)):
        bench.step(rig.lane_change(bench.t))
        found.append((bench.ecu.mode, bench.ecu.fault_active, *bench.ecu.x, *bench.ecu.force))
    return found


@pytest.mark.parametrize("observer", [fw.CONSTANT_GAIN, fw.PROPAGATED_COVARIANCE])
@pytest.mark.parametrize("rate", [0.0, 30.0, 155.0, 163.83], ids=str)
def test_whatever_the_roll_rate_says_changes_nothing(observer, rate):
    """A true roll rate against one that is stuck, beyond its range, or an error code."""
    true = rig.Bench(calibration(observer=observer))
    other = rig.Bench(calibration(observer=observer))
    other.change["Imu"] = {"RollRate": rate}
    seen = commands(true, 4.0)
    assert seen == commands(other, 4.0)
    assert seen[-1][:2] == (ACTIVE, 0)
    assert max(abs(row[-1]) for row in seen) > 100 << 14


def test_roll_is_reduced_and_known():
    bench = without(noise=(0.0, 0.05), seed=4)
    bench.run(1.0)
    passive = rig.Bench(rig.calibration(feedback=np.zeros(5), feedforward=np.zeros(5))).run(1.0)
    rolls, errors = [], []
    for _ in range(800):
        for each in (bench, passive):
            each.step(rig.lane_change(each.t))
        errors.append(bench.ecu.x[ROLL] * UNITS[ROLL] - bench.x[0])
        rolls.append((bench.x[0], passive.x[0]))
    controlled, free = np.sqrt(np.mean(np.square(rolls), axis=0))
    assert controlled < 0.8 * free
    assert np.sqrt(np.mean(np.square(errors))) < 0.1 * free
    assert bench.ecu.x[GYRO_BIAS] == 0


@pytest.mark.parametrize(
    ("change", "drop", "code"),
    [
        ({"LateralAcceleration": 40.9575}, False, sv.FAULT_ACCELERATION),
        ({"LateralAcceleration": 25.0}, False, sv.FAULT_ACCELERATION),
        ({}, True, 0),
    ],
    ids=["error code", "out of range", "late"],
)
def test_without_the_lateral_acceleration_or_its_frames_it_is_safe(change, drop, code):
    bench = without().active()
    bench.run(0.3, lambda t: 3.0)
    bench.change["Imu"] = NO_ROLL_RATE | change
    if drop:
        bench.drop.add("Imu")
    timeout = bench.cal.timeout_ticks[0]
    bench.run(timeout * TICK, lambda t: 3.0)
    assert bench.ecu.mode == ACTIVE
    bench.run(2 * TICK, lambda t: 3.0)
    assert bench.ecu.mode == SAFE
    assert bench.ecu.fault_active == 1 << code


def test_the_offset_of_the_accelerometer_is_learnt_without_a_gyro():
    bench = without(cal=calibration(offset_learning=1), bias=(0.0, 0.3)).run(30.0)
    assert bench.ecu.offset_acceleration * 2.0**-24 == pytest.approx(0.3, abs=0.02)
    assert bench.ecu.offset_rate == 0
