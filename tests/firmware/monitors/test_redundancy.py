"""Redundancy monitor: lateral acceleration and roll rate against what the others say."""

import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import plausibility as sv
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.fixed_point import magnitude
from canroll.firmware.monitors.redundancy import watch_redundancy
from canroll.firmware.monitors.residual import gap, side_of
from canroll.firmware.state import DEGRADED, GYRO_BIAS, RX_IMU, SAFE, Ecu

ACCELERATION = 2**fw.Q_ACCELERATION
SPEED = 20.0
APART, BOUND = 8, 10
SWING, PERIOD = 0.5, 0.01


def watched(**changes: int) -> fw.Calibration:
    """A calibration with the monitor on."""
    cal = rig.calibration(**changes)
    cal.redundancy_min = round(2.4 * ACCELERATION)
    cal.redundancy_share = 1 << fw.Q_SHARE - 1
    cal.redundancy_limit = round(5.0 * ACCELERATION)
    cal.opposite_min = round(1.5 * ACCELERATION)
    cal.slide_max = round(SWING / PERIOD * 2**fw.Q_SLIDE)
    cal.apart_samples, cal.bound_samples = APART, BOUND
    return cal


def moving(cal: fw.Calibration) -> Ecu:
    """An ECU of a moving car with every input."""
    ecu = rig.started(cal)
    ecu.gain_factor, ecu.motion_lost = 1 << 28, 0
    ecu.fresh[RX_IMU], ecu.valid[RX_IMU] = RX_SIGNALS[RX_IMU], 7
    return ecu


def sample(
    ecu: Ecu, cal: fw.Calibration, lateral: float, turning: float, steered: float, *, count: int = 1
) -> None:
    """Receive samples of the three lateral accelerations, m/s²."""
    ecu.lateral_acceleration = round(lateral * ACCELERATION)
    ecu.speed = round(SPEED * 2**fw.Q_SPEED)
    ecu.yaw_rate = round(turning / SPEED * 2**fw.Q_RATE)
    ecu.steering_acceleration = round(steered * ACCELERATION)
    for _ in range(count):
        watch_redundancy(ecu, cal)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("lateral", "turning", "steered", "wrong"),
    [
        (2.5, 0.0, 0.0, 1),
        (2.3, 0.0, 0.0, 0),
        (-2.5, 0.0, 0.0, 1),
        (0.5, 4.0, 4.5, 0),
        (-0.5, 4.0, 4.5, 0),
        (4.9, 1.0, 1.0, 1),
        (4.9, 3.0, 0.0, 0),
        (0.0, 4.0, 0.0, 0),
        (0.0, 0.0, 4.0, 0),
    ],
)
def test_an_acceleration_outside_both_others_is_wrong(sign, lateral, turning, steered, wrong):
    cal = watched()
    ecu = moving(cal)
    sample(ecu, cal, sign * lateral, sign * turning, sign * steered, count=APART - 1)
    assert ecu.contradicted >> 1 & 1 == 0
    sample(ecu, cal, sign * lateral, sign * turning, sign * steered)
    assert ecu.contradicted >> 1 & 1 == wrong


@pytest.mark.parametrize(("turning", "steered"), [(5.5, 0.0), (-5.5, 0.0), (0.0, 5.5)])
def test_beyond_the_linear_range_and_long_afterwards_no_distance_is_judged(turning, steered):
    cal = watched()
    ecu = moving(cal)
    sample(ecu, cal, 0.0, turning, steered, count=2)
    # the peak fades to 5/5.5 of itself in 195 samples
    sample(ecu, cal, 4.0, 0.0, 0.0, count=190)
    assert ecu.contradicted >> 1 & 1 == 0
    sample(ecu, cal, 4.0, 0.0, 0.0, count=10 + APART)
    assert ecu.contradicted >> 1 & 1 == 1


def test_a_wrong_acceleration_alone_cannot_switch_its_check_off():
    cal = watched()
    ecu = moving(cal)
    sample(ecu, cal, 30.0, 0.0, 0.0, count=APART)
    assert ecu.contradicted >> 1 & 1 == 1


@pytest.mark.parametrize("sign", [1, -1])
def test_no_slide_swings_further_than_a_driver_can_steer_against(sign):
    cal = watched()
    ecu = moving(cal)
    # the sideslip changes by yaw rate less lateral acceleration over speed: 0.9 rad/s
    count = int(SWING / (PERIOD * 18.0 / SPEED))
    sample(ecu, cal, 9.0 * sign, -9.0 * sign, 0.0, count=count)
    sample(ecu, cal, 1.0 * sign, -9.0 * sign, 0.0)
    sample(ecu, cal, 9.0 * sign, -9.0 * sign, 0.0, count=count)
    assert ecu.contradicted >> 1 & 1 == 0
    sample(ecu, cal, 9.0 * sign, -9.0 * sign, 0.0)
    assert ecu.contradicted >> 1 & 1 == 1


@pytest.mark.parametrize("limit", [5.0, 0.0], ids=["linear", "at the limit"])
@pytest.mark.parametrize(
    ("held", "turning", "wrong"),
    [(0.0, 1.6, 1), (0.0, -1.6, 1), (1.0, 2.6, 1), (-1.0, 0.6, 1), (0.0, 1.4, 0), (1.0, 2.4, 0)],
)
def test_an_acceleration_that_stays_the_same_while_the_yaw_rate_moves_is_wrong(
    held, turning, wrong, limit
):
    cal = watched(redundancy_limit=round(limit * ACCELERATION))
    ecu = moving(cal)
    sample(ecu, cal, held, held, 0.0, count=30)
    sample(ecu, cal, held, turning, turning, count=APART - 1)
    assert ecu.contradicted >> 1 & 1 == 0
    sample(ecu, cal, held, turning, turning)
    assert ecu.contradicted >> 1 & 1 == wrong


def test_an_acceleration_that_changes_by_a_bit_is_not_frozen():
    cal = watched()
    ecu = moving(cal)
    sample(ecu, cal, 0.0, 0.0, 0.0, count=30)
    for number in range(5 * APART):
        sample(ecu, cal, 0.0, 1.6, 1.6)
        if number % APART == APART - 2:
            sample(ecu, cal, 2.0**-24, 1.6, 1.6)
    assert ecu.contradicted >> 1 & 1 == 0


@pytest.mark.parametrize("bias", [0.05, -0.05])
def test_a_gyro_bias_at_its_bound_is_a_wrong_roll_rate(bias):
    cal = watched()
    cal.bias_max = round(0.05 * 2**27)
    ecu = moving(cal)
    ecu.x[GYRO_BIAS] = round(0.99 * bias * 2**27)
    sample(ecu, cal, 0.0, 0.0, 0.0, count=2 * BOUND)
    assert ecu.contradicted & 1 == 0
    ecu.x[GYRO_BIAS] = round(bias * 2**27)
    sample(ecu, cal, 0.0, 0.0, 0.0, count=BOUND - 1)
    assert ecu.contradicted & 1 == 0
    sample(ecu, cal, 0.0, 0.0, 0.0)
    assert ecu.contradicted & 1 == 1


@pytest.mark.parametrize(
    "state",
    [{"gain_factor": 0}, {"fresh": [0] * 5}, {"motion_lost": 1}, {"valid": [3, 0, 0, 0, 0]}],
)
def test_what_is_not_known_is_not_judged(state):
    cal = watched()
    ecu = moving(cal)
    for name, value in state.items():
        setattr(ecu, name, value)
    sample(ecu, cal, 9.0, -9.0, -9.0, count=60)
    assert ecu.contradicted >> 1 & 1 == 0


@pytest.mark.parametrize("change", [{"redundancy_min": 0}, {"observer": fw.BYPASS}])
def test_a_calibration_without_it_judges_nothing(change):
    cal = watched()
    ecu = moving(cal)
    for name, value in change.items():
        setattr(cal, name, value)
    sample(ecu, cal, 9.0, -9.0, -9.0, count=60)
    assert ecu.contradicted >> 1 & 1 == 0


@pytest.mark.parametrize(
    ("found", "code", "mode"),
    [
        (2, sv.FAULT_LATERAL_CONTRADICTED, DEGRADED),
        (1, sv.FAULT_ROLL_RATE_CONTRADICTED, SAFE),
    ],
)
def test_findings_last_and_decide_the_mode(found, code, mode):
    bench = rig.Bench(rig.calibration()).active()
    bench.ecu.contradicted = found
    for _ in range(2 * bench.cal.recovery_ticks):
        bench.step()
        assert bench.ecu.mode == mode
    assert bench.ecu.fault_active >> code & 1 == 1
    assert bench.ecu.lateral_lost == (found == 2)


def test_the_arithmetic():
    assert [gap(value, 5, -3) for value in (7, 5, 0, -3, -4)] == [2, 0, 0, 0, 1]
    assert [gap(value, -3, 5) for value in (7, 5, 0, -3, -4)] == [2, 0, 0, 0, 1]
    assert [magnitude(value) for value in (-(2**31), -2, 0, 2)] == [fw.STATE_MAX, 2, 0, 2]
    assert [side_of(*pair, 1) for pair in ((2, 2), (-2, -2), (2, 1), (2, -2))] == [1, -1, 0, 0]


def mirror(**changes: int) -> fw.Calibration:
    """A calibration that judges mirror images alone."""
    cal = watched(**changes)
    cal.redundancy_min = fw.STATE_MAX // 2
    cal.opposite_min = fw.STATE_MAX
    cal.mirror_limit, cal.mirror_min = round(10.0 * ACCELERATION), round(0.5 * ACCELERATION)
    return cal


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("lateral", "turning", "steered", "wrong"),
    [
        (-3.0, -3.0, 3.0, 1),
        (-2.0, -2.2, 3.0, 1),
        # both as steered, one of them alone, of other magnitude
        (3.0, 3.0, 3.0, 0),
        (-3.0, 3.0, 3.0, 0),
        (3.0, -3.0, 3.0, 0),
        (-3.5, -6.0, 0.5, 0),
        (-3.0, -1.0, 8.0, 0),
        (-0.2, -0.2, 0.2, 0),
        # and the limit of the tyres
        (-9.0, -11.0, 9.0, 0),
    ],
)
def test_a_unit_that_mirrors_the_steering_is_wrong(sign, lateral, turning, steered, wrong):
    cal = mirror()
    ecu = moving(cal)
    sample(ecu, cal, sign * lateral, sign * turning, sign * steered, count=40)
    assert ecu.contradicted >> 2 & 1 == wrong


def test_a_mirror_image_is_found_within_a_tenth_of_a_second():
    cal = mirror()
    ecu = moving(cal)
    sample(ecu, cal, 2.0, 2.0, 2.0, count=100)
    sample(ecu, cal, -2.0, -2.0, 2.0, count=10)
    assert ecu.contradicted >> 2 & 1 == 1


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("slide", "countersteer"), [(6.0, -3.0), (6.0, -6.0), (2.0, -2.0)])
def test_countersteer_in_a_slide_is_no_mirror_image(sign, slide, countersteer):
    cal = mirror()
    ecu = moving(cal)
    sample(ecu, cal, sign * slide, sign * slide, sign * slide, count=20)
    sample(ecu, cal, sign * slide, sign * slide, sign * countersteer, count=200)
    assert ecu.contradicted >> 2 & 1 == 0


def test_each_excursion_from_straight_is_judged_anew():
    cal = mirror()
    ecu = moving(cal)
    sample(ecu, cal, 2.0, 2.0, 2.0, count=50)
    sample(ecu, cal, 0.1, 0.1, 0.0, count=50)
    sample(ecu, cal, 0.1, 0.1, -2.0, count=5)
    sample(ecu, cal, 2.0, 2.0, -2.0, count=20)
    assert ecu.contradicted >> 2 & 1 == 1


def test_a_mirrored_motion_is_safe_and_a_fault_code():
    cal = mirror()
    ecu = moving(cal)
    ecu.contradicted = 4
    ecu.detected = 0
    assert sv.watch_imu(ecu, cal, 1) == sv.UNSAFE
    assert ecu.detected >> sv.FAULT_MOTION_CONTRADICTED & 1 == 1
