"""Learning of sensor offsets: when, how far, and when not."""

import numpy as np
import pytest
import rig

from canroll.firmware.state import ACTIVE

BIAS = (np.radians(0.8), 0.3)


def learnt(bench: rig.Bench) -> tuple[float, float]:
    return bench.ecu.offset_rate / 2**27, bench.ecu.offset_acceleration / 2**24


def drive(seconds: float, ay=lambda t: 0.0, **options) -> rig.Bench:
    calibration = options.pop("cal", None) or rig.calibration(offset_learning=1)
    bench = rig.Bench(calibration, bias=options.pop("bias", BIAS), **options)
    return bench.run(seconds, ay)


def test_straight_ahead_both_offsets_are_found():
    rate, acceleration = learnt(drive(30.0, noise=(0.0017, 0.05)))
    assert rate == pytest.approx(BIAS[0], abs=4e-4)
    assert acceleration == pytest.approx(BIAS[1], abs=0.02)


def test_at_standstill_only_the_gyro_learns():
    """What the accelerometer reads there is the slope of the ground."""
    rate, acceleration = learnt(drive(30.0, speed_kmh=0.0, bias=(BIAS[0], 0.0), ay=lambda t: 0.4))
    assert rate == pytest.approx(BIAS[0], abs=4e-4)
    assert acceleration == 0.0


def test_switched_off_nothing_is_learnt():
    assert learnt(drive(3.0, cal=rig.calibration())) == (0.0, 0.0)


def test_offsets_keep_to_their_limits():
    bench = drive(40.0, bias=(0.09, -1.5))
    assert learnt(bench) == pytest.approx((0.035, -0.5), abs=1e-6)


def test_learning_takes_the_roll_and_the_moment_that_offsets_cause():
    """An accelerometer offset leans the estimate; once learnt, the car runs without a command."""
    bias = (0.0, 0.4)
    plain = rig.Bench(rig.calibration(), bias=bias).run(40.0)
    learning = rig.Bench(rig.calibration(offset_learning=1), bias=bias).run(40.0)
    assert plain.ecu.mode == learning.ecu.mode == ACTIVE
    assert abs(plain.ecu.moment) > 80 << 14
    assert abs(learning.ecu.moment) < 8 << 14
