"""The roll rate against those of the suspensions, for a gyro that is off, drifts or is reversed.

The body rolls as its suspensions do, and as the wheels do: on their tyres by a small part of it,
but at once by what the delivered moments change, on a bank slowly, and over bumps one axle after
the other. So the roll rate is wrong where it is far outside of the interval between the rates of
both axles, low-passed, for a while. A single wrong stroke rate widens the interval and accuses
nobody. Once wheels may have left the road it rests.

A gyro that stands still to the last bit while both suspensions change their rates to one side is
stuck: no motion and no noise does that, at the tyres' limit neither.
"""

from canroll.firmware.calibration import Q_SHARE, STATE_MAX, Calibration
from canroll.firmware.fixed_point import magnitude, product
from canroll.firmware.monitors.residual import (
    FRONT,
    REAR,
    ROLLING,
    STANDING,
    beyond,
    gap,
    high_pass,
    judge,
    low_pass,
    peak_hold,
    side_of,
)
from canroll.firmware.plausibility import NEEDED
from canroll.firmware.state import RX_IMU, RX_SUSPENSION_RATE, Ecu
from canroll.firmware.subset import clamp, i32, rsh, sat31

# bits of ecu.valid of an Imu frame; the first is the roll rate's of cal.measurements too
ROLL_SIGNAL = 1
YAW = 4
# what may be left over fades in 8 time constants of the low-pass
FADING = 3


def measured(ecu: Ecu, cal: Calibration) -> i32:
    """Return 1 where stroke rates, and the roll rate if in use, are known and new, in motion."""
    stroke: i32 = NEEDED[RX_SUSPENSION_RATE]
    rate: i32 = cal.measurements & ROLL_SIGNAL
    if (ecu.valid[RX_IMU] & rate) != rate:
        return 0
    if (ecu.valid[RX_SUSPENSION_RATE] & stroke) != stroke:
        return 0
    # a frame that repeats its sample is no news
    if ecu.unchanged[RX_SUSPENSION_RATE] > cal.timeout_ticks[RX_SUSPENSION_RATE]:
        return 0
    if ecu.unchanged[RX_IMU] > cal.timeout_ticks[RX_IMU] or ecu.gain_factor == 0:
        return 0
    return 1


def within(ecu: Ecu, limit: i32) -> i32:
    """Return 1 where yaw rate and steering tell that the car has stayed below ``limit``."""
    if (ecu.valid[RX_IMU] & YAW) == 0 or ecu.motion_lost == 1:
        return 0
    if ecu.motion_peak > limit:
        return 0
    return 1


def watch_standing(ecu: Ecu, cal: Calibration, front: i32, rear: i32) -> None:
    """Judge whether the roll rate stands still while the suspensions roll at other rates."""
    stands: i32 = 0
    if ecu.roll_rate != ecu.standing_rate:
        ecu.standing_rate = ecu.roll_rate
        ecu.standing_front = front
        ecu.standing_rear = rear
    elif side_of(front - ecu.standing_front, rear - ecu.standing_rear, cal.rolling_min) != 0:
        stands = 1
    judge(ecu, STANDING, stands, cal.rolling_ticks)


def watch_rolling(ecu: Ecu, cal: Calibration) -> None:
    """Judge the roll rate by the newest samples."""
    if cal.rolling_min == 0 or (cal.measurements & ROLL_SIGNAL) == 0:
        return
    if measured(ecu, cal) == 0:
        ecu.rolling_known = 0
        ecu.evidence[STANDING] = 0
        return
    front: i32 = product(ecu.stroke_rate[0] - ecu.stroke_rate[1], cal.rolling_track[0], 28)
    rear: i32 = product(ecu.stroke_rate[2] - ecu.stroke_rate[3], cal.rolling_track[1], 28)
    watch_standing(ecu, cal, front, rear)
    if within(ecu, cal.axles_limit) == 0:
        ecu.rolling_known = 0
        return
    moment: i32 = sat31(ecu.delivered[0] + ecu.delivered[1])
    if ecu.rolling_known == 0:
        ecu.rolling_known = 1
        ecu.passed[ROLLING] = ecu.roll_rate
        ecu.passed[FRONT] = front
        ecu.passed[REAR] = rear
        ecu.past[ROLLING] = moment
        ecu.bound[ROLLING] = 0
        ecu.evidence[ROLLING] = 0
    rate: i32 = low_pass(ecu, ROLLING, ecu.roll_rate, cal.response_pass)
    front = low_pass(ecu, FRONT, front, cal.response_pass)
    rear = low_pass(ecu, REAR, rear, cal.response_pass)
    # so much it has changed within about the low-pass's time constant
    changed: i32 = high_pass(ecu, ROLLING, moment, cal.response_pass)
    larger: i32 = clamp(magnitude(front), magnitude(rear), STATE_MAX)
    on_tyres: i32 = magnitude(product(changed, cal.rolling_tyres, 17))
    now: i32 = sat31(product(larger, cal.rolling_share, Q_SHARE) + on_tyres)
    bound: i32 = peak_hold(ecu.bound[ROLLING], now, rsh(cal.response_pass, FADING))
    ecu.bound[ROLLING] = bound
    bad: i32 = beyond(gap(rate, front, rear), sat31(cal.rolling_min + bound))
    judge(ecu, ROLLING, bad, cal.rolling_ticks)
