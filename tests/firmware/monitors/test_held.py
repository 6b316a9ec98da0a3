"""Signals that stand still to the last bit while what they are compared with moves."""

import pytest
import rig

from firmware import calibration as fw
from firmware.monitors.held import watch_held
from firmware.monitors.residuals import GYRO, LATERAL, MOTION, STROKE, YAW
from firmware.state import Ecu

TRACK = 1.6
LATERAL_TICKS, ROLL_TICKS = 8, 5
ACCELERATION, RATE = 2**fw.Q_ACCELERATION, 2**fw.Q_RATE


def watched() -> fw.Calibration:
    """A calibration with the rule on for both signals."""
    cal = rig.calibration()
    cal.held_min = [round(1.5 * ACCELERATION), round(0.06 * RATE)]
    cal.held_ticks = [LATERAL_TICKS, ROLL_TICKS]
    cal.held_roll = [round(2**28 / TRACK)] * 2
    return cal


def moving(cal: fw.Calibration) -> Ecu:
    ecu = rig.started(cal)
    ecu.residual_trust = GYRO | LATERAL | YAW | MOTION | STROKE
    return ecu


def sample(ecu, cal, *, lateral=0.0, turning=0.0, roll=0.0, axles=(0.0, 0.0), count=1):
    """Ticks with these lateral accelerations (m/s²) and roll rates (rad/s)."""
    ecu.lateral_acceleration = round(lateral * ACCELERATION)
    ecu.residual_input[7] = round(turning * ACCELERATION)
    ecu.roll_rate = round(roll * RATE)
    ecu.residual_input[:2] = [round(axle * TRACK * RATE) for axle in axles]
    for _ in range(count):
        watch_held(ecu, cal)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("held", "turning", "wrong"), [(0.0, 1.6, 1), (1.0, 2.6, 1), (0.0, 1.4, 0)]
)
def test_an_acceleration_that_stands_still_while_the_car_turns_is_wrong(sign, held, turning, wrong):
    cal = watched()
    ecu = moving(cal)
    sample(ecu, cal, lateral=sign * held, turning=sign * held, count=30)
    sample(ecu, cal, lateral=sign * held, turning=sign * turning, count=LATERAL_TICKS - 1)
    assert ecu.lateral_contradicted == 0
    sample(ecu, cal, lateral=sign * held, turning=sign * turning)
    assert ecu.lateral_contradicted == wrong


def test_a_bit_of_change_is_enough():
    cal = watched()
    ecu = moving(cal)
    sample(ecu, cal, count=30)
    for number in range(5 * LATERAL_TICKS):
        sample(ecu, cal, turning=1.6)
        if number % LATERAL_TICKS == LATERAL_TICKS - 2:
            sample(ecu, cal, lateral=2.0**-24, turning=1.6)
    assert ecu.lateral_contradicted == 0


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("axles", "wrong"),
    [((0.07, 0.07), 1), ((0.07, 0.05), 0), ((0.05, 0.07), 0), ((0.2, -0.2), 0)],
)
def test_a_roll_rate_that_stands_still_while_both_suspensions_roll_is_wrong(sign, axles, wrong):
    cal = watched()
    ecu = moving(cal)
    sample(ecu, cal, roll=0.01, count=30)
    both = sign * axles[0], sign * axles[1]
    sample(ecu, cal, roll=0.01, axles=both, count=ROLL_TICKS - 1)
    assert ecu.rate_contradicted == 0
    sample(ecu, cal, roll=0.01, axles=both)
    assert ecu.rate_contradicted == wrong


@pytest.mark.parametrize("missing", [LATERAL, YAW, MOTION, GYRO, STROKE])
def test_what_is_not_trusted_is_not_judged(missing):
    cal = watched()
    ecu = moving(cal)
    ecu.residual_trust &= ~missing
    sample(ecu, cal, count=30)
    sample(ecu, cal, turning=9.0, axles=(1.0, 1.0), count=30)
    of_lateral = missing in (LATERAL, YAW, MOTION)
    assert ecu.lateral_contradicted == (not of_lateral)
    assert ecu.rate_contradicted == of_lateral


def test_a_roll_rate_that_the_observer_does_not_use_is_not_judged():
    cal = watched()
    cal.held_roll = [0, 0]
    ecu = moving(cal)
    sample(ecu, cal, count=30)
    sample(ecu, cal, axles=(1.0, 1.0), count=30)
    assert ecu.rate_contradicted == 0
