"""Mirror monitor: an inertial unit whose motion is the negative of what steering gives."""

import pytest
import rig

from firmware import calibration as fw
from firmware import plausibility as sv
from firmware.com.signals import RX_SIGNALS
from firmware.monitors.mirror import opposite, watch_mirror
from firmware.monitors.persistence import lasting, magnitude
from firmware.state import DEGRADED, RX_IMU, SAFE, Ecu

ACCELERATION = 2**fw.Q_ACCELERATION
SPEED = 20.0


def mirror() -> fw.Calibration:
    """A calibration that judges mirror images."""
    cal = rig.calibration()
    cal.mirror_limit, cal.mirror_min = round(10.0 * ACCELERATION), round(0.5 * ACCELERATION)
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
        watch_mirror(ecu, cal)


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
    assert ecu.motion_contradicted == wrong


def test_a_mirror_image_is_found_within_a_tenth_of_a_second():
    cal = mirror()
    ecu = moving(cal)
    sample(ecu, cal, 2.0, 2.0, 2.0, count=100)
    sample(ecu, cal, -2.0, -2.0, 2.0, count=10)
    assert ecu.motion_contradicted == 1


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("slide", "countersteer"), [(6.0, -3.0), (6.0, -6.0), (2.0, -2.0)])
def test_countersteer_in_a_slide_is_no_mirror_image(sign, slide, countersteer):
    cal = mirror()
    ecu = moving(cal)
    sample(ecu, cal, sign * slide, sign * slide, sign * slide, count=20)
    sample(ecu, cal, sign * slide, sign * slide, sign * countersteer, count=200)
    assert ecu.motion_contradicted == 0


def test_each_excursion_from_straight_is_judged_anew():
    cal = mirror()
    ecu = moving(cal)
    sample(ecu, cal, 2.0, 2.0, 2.0, count=50)
    sample(ecu, cal, 0.1, 0.1, 0.0, count=50)
    sample(ecu, cal, 0.1, 0.1, -2.0, count=5)
    sample(ecu, cal, 2.0, 2.0, -2.0, count=20)
    assert ecu.motion_contradicted == 1


def test_a_mirrored_motion_is_safe_and_a_fault_code():
    cal = mirror()
    ecu = moving(cal)
    ecu.motion_contradicted = 1
    ecu.found = 0
    assert sv.watch_imu(ecu, cal, 1) == sv.UNSAFE
    assert ecu.found >> sv.FAULT_MOTION_CONTRADICTED & 1 == 1


@pytest.mark.parametrize(
    "state",
    [{"gain_factor": 0}, {"fresh": [0] * 5}, {"motion_lost": 1}, {"valid": [3, 0, 0, 0, 0]}],
)
def test_what_is_not_known_is_not_judged(state):
    cal = mirror()
    ecu = moving(cal)
    for name, value in state.items():
        setattr(ecu, name, value)
    sample(ecu, cal, -3.0, -3.0, 3.0, count=40)
    assert ecu.motion_contradicted == 0
    assert ecu.motion_peak == 0


def test_a_calibration_without_it_judges_nothing():
    cal = mirror()
    cal.mirror_min = 0
    ecu = moving(cal)
    sample(ecu, cal, -3.0, -3.0, 3.0, count=40)
    assert ecu.motion_contradicted == 0


@pytest.mark.parametrize(("turning", "steered"), [(5.5, 0.0), (-5.5, 0.0), (0.0, -5.5)])
def test_the_largest_motion_of_yaw_rate_or_steering_fades_slowly(turning, steered):
    cal = mirror()
    ecu = moving(cal)
    sample(ecu, cal, 30.0, turning, steered, count=2)
    sample(ecu, cal, 30.0, 0.0, 0.0, count=195)
    assert ecu.motion_peak == pytest.approx(5.0 * ACCELERATION, rel=0.01)


def test_the_arithmetic():
    assert [magnitude(value) for value in (-(2**31), -2, 0, 2)] == [fw.STATE_MAX, 2, 0, 2]
    assert [lasting(2, 1, 5), lasting(5, 1, 5), lasting(5, 0, 5)] == [3, 5, 0]
    assert [opposite(2, -2), opposite(-2, 2), opposite(2, 2), opposite(2, 0)] == [1, 1, 0, 0]


@pytest.mark.parametrize(
    ("found", "code", "mode"),
    [
        ("lateral_contradicted", sv.FAULT_LATERAL_CONTRADICTED, DEGRADED),
        ("rate_contradicted", sv.FAULT_ROLL_RATE_CONTRADICTED, SAFE),
    ],
)
def test_findings_last_and_decide_the_mode(found, code, mode):
    bench = rig.Bench(rig.calibration()).active()
    setattr(bench.ecu, found, 1)
    for _ in range(2 * bench.cal.recovery_ticks):
        bench.step()
        assert bench.ecu.mode == mode
    assert bench.ecu.fault_active >> code & 1 == 1
    assert bench.ecu.lateral_lost == (found == "lateral_contradicted")
