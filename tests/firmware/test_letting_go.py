"""What the car leans on is not taken from it at once: held outputs, corners, a restart."""

import numpy as np
import pytest
import rig
from scipy.integrate import solve_ivp

from canroll.firmware import calibration as fw
from canroll.firmware.control_law import control, curve
from canroll.firmware.state import ACTIVE, INIT, RX_IMU, SAFE
from canroll.firmware.supervisor import change_mode, fade

Q = 1 << fw.Q_ACCELERATION
FULL = 1 << 30


def moving(lateral=0.0, turning=0.0, steered=0.0, **state):
    """An ECU that has just read these three lateral accelerations, m/s²."""
    cal = rig.calibration()
    ecu = rig.started(cal)
    ecu.valid[RX_IMU], ecu.motion_lost = 7, 0
    ecu.lateral_acceleration, ecu.steering_acceleration = round(lateral * Q), round(steered * Q)
    ecu.speed, ecu.yaw_rate = 20 << fw.Q_SPEED, round(turning / 20 * 2**fw.Q_RATE)
    for name, value in state.items():
        setattr(ecu, name, value)
    return ecu, cal


@pytest.mark.parametrize(
    ("sensors", "known"),
    [
        ((6.0, 6.5, 7.0), 6.5),
        ((-6.0, 6.5, 7.0), 6.5),
        ((6.0, -6.5, 7.0), 6.0),
        ((6.0, 6.5, -7.0), 6.0),
        ((0.0, -6.5, 7.0), 0.0),
    ],
)
def test_no_one_sensor_turns_the_curve_round(sensors, known):
    ecu, cal = moving(*sensors)
    assert curve(ecu, cal) / Q == pytest.approx(known, abs=1e-5)


@pytest.mark.parametrize(
    "state", [{"lateral_lost": 1}, {"motion_lost": 1}, {"valid": [3, 3, 3, 3, 3]}], ids=str
)
def test_of_two_that_disagree_nothing_is_known(state):
    signs = {"lateral_lost": (9, 6, -7), "motion_lost": (6, -6.5, 9), "valid": (6, 9, -7)}
    ecu, cal = moving(*signs[next(iter(state))], **state)
    assert curve(ecu, cal) == 0


@pytest.mark.parametrize(("held", "left"), [(-1000, -500), (1000, 0)])
def test_a_held_moment_fades_and_never_pushes_outward(held, left):
    ecu, cal = moving(6.0, 6.0, 6.0, mode=SAFE, released=FULL // 2)
    ecu.held = [held << 14, 0]
    control(ecu, cal, 1)
    assert ecu.moment == left << 14


def test_in_an_unknown_curve_it_fades_to_either_side():
    ecu, cal = moving(6.0, -6.0, 0.0, mode=SAFE, released=FULL // 2)
    ecu.held = [1000 << 14, 0]
    control(ecu, cal, 1)
    assert ecu.moment == 500 << 14


@pytest.mark.parametrize("authority", [0, FULL // 4, FULL])
def test_law_and_what_is_held_make_one_moment(authority):
    ecu, cal = moving(6.0, 6.0, 6.0, mode=ACTIVE, gain_factor=1 << 28, released=FULL)
    ecu.authority, ecu.ahead = authority, [0, 1 << 24, 0, 0, 0]
    ecu.held = [-1000 << 14, 0]
    control(ecu, cal, 1)
    alone, _ = moving(mode=ACTIVE, gain_factor=1 << 28, authority=FULL)
    alone.ahead = list(ecu.ahead)
    control(alone, cal, 1)
    share = authority / FULL
    assert ecu.moment == pytest.approx(share * alone.moment - (1 - share) * (1000 << 14), abs=2)


@pytest.mark.parametrize("unknown", [0, 1])
def test_after_a_restart_the_law_takes_over_what_is_delivered(unknown):
    ecu, cal = moving(mode=INIT, moment_unknown=unknown)
    ecu.delivered, ecu.good_ticks = [-3000 << 14, -500 << 14], cal.init_ticks
    change_mode(ecu, cal, 0)
    assert ecu.mode == ACTIVE
    held = 0 if unknown else -3500 << 14
    assert (ecu.held[0], ecu.outputs[0], ecu.guarded[0]) == (held, held, held)
    assert ecu.authority == 0


def test_a_failed_corner_fades_and_comes_back_along_the_ramp():
    ecu, cal = moving()
    ecu.failed = [1, 0, 0, 0]
    fade(ecu, cal, cal.release_ticks // 2)
    assert ecu.trust == [pytest.approx(FULL // 2, rel=1e-6), FULL, FULL, FULL]
    ecu.failed = [0, 0, 0, 0]
    fade(ecu, cal, cal.ramp_ticks)
    assert ecu.trust == [FULL] * 4


def overshoot(duration, damping):
    """Roll beyond its end, of the whole way, where a moment fades in ``duration`` periods."""
    omega = 2 * np.pi

    def rates(t, x):
        moment = max(0.0, 1 - t / duration) if duration > 0 else 0.0
        return [x[1], -2 * damping * omega * x[1] - omega**2 * (x[0] - moment)]

    answer = solve_ivp(rates, (0, 6), [1.0, 0.0], max_step=0.01, rtol=1e-8, atol=1e-10)
    return max(0.0, -answer.y[0].min())


@pytest.mark.parametrize(("damping", "most"), [(0.0, 1e-6), (0.2, 0.09), (0.5, 0.05)])
def test_over_one_period_of_the_roll_the_body_hardly_overshoots(damping, most):
    # by an integrator of another's, on the oscillator alone
    of_a_step = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert overshoot(0.0, damping) == pytest.approx(of_a_step, abs=1e-3)
    assert overshoot(1.0, damping) < most
