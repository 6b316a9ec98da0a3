"""Rolling monitor: the roll rate against the suspensions of a body that rolls on its tyres."""

import numpy as np
import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import plausibility as sv
from canroll.firmware.monitors.rolling import watch_rolling
from canroll.firmware.state import RX_IMU, RX_SUSPENSION_RATE, SAFE, Ecu
from canroll.firmware.supervisor import supervise

TRACKS = np.array([1.6, 1.5])
STEP, LEAST, TICKS = 0.01, 0.1, 8
TIMES = np.arange(0.0, 4.0, STEP)
RATE = 0.35 * np.sin(2.0 * np.pi * 0.5 * TIMES)
NO_MOMENT = np.zeros(len(TIMES))
TYRES = 5e5
"""Roll stiffness of the tyres, N·m/rad."""
ON_TYRES = 0.85
"""Share of the suspensions in the roll rate."""


def watched() -> fw.Calibration:
    """A calibration with the monitor on."""
    cal = rig.calibration(actuator=fw.BARS)
    cal.timeout_ticks[RX_SUSPENSION_RATE] = 5
    cal.response_pass = round(STEP / 0.05 * 2**30)
    cal.rolling_min = round(LEAST * 2**fw.Q_RATE)
    cal.rolling_ticks = TICKS
    cal.axles_limit = 10 << fw.Q_ACCELERATION
    cal.rolling_share = round(0.25 * 2**fw.Q_SHARE)
    cal.rolling_tyres = round(1.0 / (0.05 * TYRES) * 2**30)
    cal.rolling_track = [round(1.0 / track * 2**28) for track in TRACKS]
    return cal


def moving(cal: fw.Calibration) -> Ecu:
    """An ECU of a moving car with every input."""
    ecu = rig.started(cal)
    ecu.gain_factor, ecu.motion_lost = 1 << 28, 0
    ecu.valid[RX_IMU], ecu.valid[RX_SUSPENSION_RATE] = 7, 15
    return ecu


def replay(
    ecu: Ecu,
    cal: fw.Calibration,
    gyro: np.ndarray,
    axles: np.ndarray,
    moment: np.ndarray = NO_MOMENT,
) -> int:
    """Let the monitor judge samples of the gyro and of both suspensions; return when it accused."""
    for number, (rate, of_axles) in enumerate(zip(gyro, axles, strict=True)):
        ecu.delivered = [round(0.5 * moment[number] * 2**fw.Q_MOMENT)] * 2
        ecu.roll_rate = round(rate * 2**fw.Q_RATE)
        front, rear = (round(0.5 * rolls * 2**fw.Q_RATE) for rolls in of_axles * TRACKS)
        ecu.stroke_rate = [front, -front, rear, -rear]
        watch_rolling(ecu, cal)
        if ecu.contradicted & 1:
            return number
    return len(TIMES)


def suspensions(rate: np.ndarray = RATE) -> np.ndarray:
    """Rates of both axles' suspensions at a roll rate, rad/s."""
    return np.stack([ON_TYRES * rate, (ON_TYRES + 0.05) * rate], axis=1)


@pytest.mark.parametrize(
    ("gyro", "wrong"),
    [
        (RATE, 0),
        (1.1 * RATE, 0),
        (RATE + 0.04, 0),
        (RATE + 0.25, 1),
        (RATE - 0.25, 1),
        (RATE + 0.08 * TIMES, 1),
        (-RATE, 1),
        (2.2 * RATE, 1),
    ],
    ids=["true", "110 %", "bias", "offset", "negative offset", "drift", "reversed", "220 %"],
)
def test_a_roll_rate_that_neither_suspension_bears_out_is_wrong(gyro, wrong):
    cal = watched()
    ecu = moving(cal)
    replay(ecu, cal, gyro, suspensions())
    assert ecu.contradicted & 1 == wrong


@pytest.mark.parametrize(("offset", "samples"), [(0.15, 12), (0.3, 7)])
def test_an_offset_is_found_within_a_tenth_of_a_second_or_so(offset, samples):
    cal = watched()
    ecu = moving(cal)
    straight = np.zeros(len(TIMES))
    gyro = np.where(TIMES < 1.0, 0.0, offset)
    assert replay(ecu, cal, gyro, suspensions(straight)) - 100 + 1 == samples


def test_bumps_that_one_axle_meets_after_the_other_accuse_nobody():
    cal = watched()
    ecu = moving(cal)
    # one wheel at 1 m/s up, then down, which the rear axle meets 0.15 s later
    axles = suspensions()
    for axle, late in enumerate([0.0, 0.15]):
        phase = TIMES - 1.0 - late
        axles[:, axle] += np.where((phase > 0) & (phase < 0.1), -0.6 * np.sign(phase - 0.05), 0.0)
    replay(ecu, cal, RATE, axles)
    assert ecu.contradicted & 1 == 0


@pytest.mark.parametrize(("told", "wrong"), [(1, 0), (0, 1)], ids=["delivered", "from elsewhere"])
def test_wheels_may_roll_on_their_tyres_at_once_by_what_is_delivered(told, wrong):
    cal = watched()
    ecu = moving(cal)
    moment = 11000.0 * np.sin(2.0 * np.pi * 3.0 * np.maximum(0.0, TIMES - 1.0))
    rolls = np.gradient(moment, STEP) / TYRES
    axles = suspensions() - rolls[:, None]
    replay(ecu, cal, RATE, axles, told * moment)
    assert ecu.contradicted & 1 == wrong


@pytest.mark.parametrize(
    ("front", "rear", "bit", "stuck"),
    [
        (1.0, 1.0, 0.0, 1),
        (-1.0, -1.0, 0.0, 1),
        (1.0, -1.0, 0.0, 0),
        (1.0, 0.0, 0.0, 0),
        (1.0, 1.0, 0.001, 0),
    ],
)
def test_a_roll_rate_that_stands_still_while_the_suspensions_move_is_stuck(front, rear, bit, stuck):
    cal = watched()
    ecu = moving(cal)
    # what the low-passed rates are judged by rests at the tyres' limit
    ecu.motion_peak = 11 << fw.Q_ACCELERATION
    gyro = bit * (np.arange(len(TIMES)) % 2) - 0.1
    rates = np.outer(np.where(TIMES < 1.0, 0.0, 1.2 * LEAST), [front, rear])
    found = replay(ecu, cal, gyro, rates)
    assert ecu.contradicted & 1 == stuck
    assert found == (100 + TICKS - 1 if stuck else len(TIMES))


@pytest.mark.parametrize("axle", [0, 1])
@pytest.mark.parametrize("factor", [0.0, -1.0, 3.0])
def test_one_wrong_stroke_rate_accuses_nobody(axle, factor):
    cal = watched()
    ecu = moving(cal)
    axles = suspensions()
    axles[:, axle] *= factor
    replay(ecu, cal, RATE, axles)
    assert ecu.contradicted & 1 == 0


def test_a_bank_is_too_slow_to_accuse():
    cal = watched()
    ecu = moving(cal)
    # ten degrees within two seconds
    replay(ecu, cal, RATE + np.where(TIMES < 2.0, np.radians(5.0), 0.0), suspensions())
    assert ecu.contradicted & 1 == 0


@pytest.mark.parametrize(("measurements", "wrong"), [(1, 1), (2, 0), (3, 1)])
def test_a_roll_rate_that_is_no_measurement_is_not_judged(measurements, wrong):
    cal = watched()
    cal.measurements = measurements
    ecu = moving(cal)
    replay(ecu, cal, -RATE, suspensions())
    assert ecu.contradicted & 1 == wrong


@pytest.mark.parametrize(
    "state",
    [
        {"gain_factor": 0},
        {"motion_lost": 1},
        {"motion_peak": 11 << fw.Q_ACCELERATION},
        {"valid": [6, 3, 15, 3, 7]},
        {"valid": [7, 3, 14, 3, 7]},
        {"unchanged": [0, 0, 6, 0, 0]},
        {"unchanged": [6, 0, 0, 0, 0]},
    ],
    ids=str,
)
def test_nothing_is_judged_unless_all_is_measured_in_motion(state):
    cal = watched()
    ecu = moving(cal)
    for name, value in state.items():
        setattr(ecu, name, value)
    replay(ecu, cal, -RATE, suspensions())
    assert ecu.contradicted & 1 == 0
    # afterwards it starts anew, from what is now
    restored = moving(cal)
    for name in state:
        setattr(ecu, name, getattr(restored, name))
    replay(ecu, cal, RATE, suspensions())
    assert ecu.contradicted & 1 == 0


def test_off_it_does_nothing():
    cal = watched()
    cal.rolling_min = 0
    ecu = moving(cal)
    replay(ecu, cal, -RATE, suspensions())
    assert ecu.contradicted & 1 == 0
    assert ecu.rolling_known == 0


def test_the_roll_rate_is_not_believed_afterwards():
    cal = watched()
    ecu = moving(cal)
    replay(ecu, cal, -RATE, suspensions())
    ecu.mode = 1
    supervise(ecu, cal, 1)
    assert ecu.mode == SAFE
    assert ecu.fault_active >> sv.FAULT_ROLL_RATE_CONTRADICTED & 1
