"""Analytic redundancy of the motion sensors: each against what the others say.

The lateral acceleration is also yaw rate times speed, and what steering angle and speed give. In
the tyres' linear range it is wrong where it lies far outside both; beyond, and long afterwards, as
their own motion tells and never the accelerometer's, only two things are judged. One is a sample
that stays the same to the last bit while yaw rate times speed moves. The other is an opposite sign
of lateral acceleration and yaw rate: a car that comes back from a slide shows it, and its sideslip
changes by the yaw rate less the lateral acceleration over the speed; where that swing is larger
than any that a driver can steer against, the acceleration is wrong. Where both agree, turned away
from where the car was steered to, and are the mirror image of what steering gives, the unit is
reversed or replayed, or the angle is reversed. A wrong roll rate drives the observer's gyro bias to
its bound, which no real bias comes near.
"""

from canroll.firmware.calibration import (
    BYPASS,
    Q_ACCELERATION,
    Q_SLIDE,
    Q_SPEED,
    STATE_MAX,
    Calibration,
)
from canroll.firmware.fixed_point import magnitude, product, with_share
from canroll.firmware.monitors.residual import (
    APART,
    BIAS,
    MIRROR,
    MIRRORED,
    SLIDE,
    STEERED,
    gap,
    judge,
    low_pass,
    peak_hold,
    side_of,
)
from canroll.firmware.state import FIRST_FRAME, GYRO_BIAS, RX_IMU, Ecu
from canroll.firmware.subset import clamp, i32, rsh, sat31

# bits of ecu.valid of an Imu frame: lateral acceleration and yaw rate
LATERAL_AND_YAW = 6
# weights: the largest motion of the others fades slowly to tell whether the tyres can be trusted,
# faster for the distance that is expected
TRUST = 0
DISTANCE = 1
# the mirror image: the motion follows steering, and what is nearer is averaged
FOLLOWING = 2
AVERAGING = 3


def frozen(ecu: Ecu, cal: Calibration, lateral: i32, turning: i32) -> i32:
    """Return 1 where the lateral acceleration is what it was at another yaw rate times speed."""
    if lateral != ecu.frozen_lateral:
        ecu.frozen_lateral = lateral
        ecu.frozen_turning = turning
        return 0
    if magnitude(turning - ecu.frozen_turning) > cal.opposite_min:
        return 1
    return 0


def watch_lateral_acceleration(ecu: Ecu, cal: Calibration, turning: i32) -> None:
    """Judge a sample of the lateral acceleration by yaw rate, speed and steering angle."""
    lateral: i32 = ecu.lateral_acceleration
    steered: i32 = ecu.steering_acceleration
    motion: i32 = clamp(magnitude(turning), magnitude(steered), STATE_MAX)
    ecu.motion_peak = peak_hold(ecu.motion_peak, motion, cal.redundancy_pass[TRUST])
    ecu.motion_now = peak_hold(ecu.motion_now, motion, cal.redundancy_pass[DISTANCE])
    apart: i32 = frozen(ecu, cal, lateral, turning)
    if ecu.motion_peak < cal.redundancy_limit:
        limit: i32 = with_share(cal.redundancy_min, ecu.motion_now, cal.redundancy_share)
        if gap(lateral, turning, steered) > limit:
            apart = 1
    judge(ecu, APART, apart, cal.apart_samples)
    if side_of(lateral, -turning, cal.opposite_min) == 0:
        ecu.slide = 0
        return
    ecu.slide = sat31(ecu.slide + rsh(magnitude(turning - lateral), Q_ACCELERATION - Q_SLIDE))
    if ecu.slide > product(ecu.speed, cal.slide_max, Q_SPEED):
        judge(ecu, SLIDE, 1, 1)


def watch_side(ecu: Ecu, cal: Calibration, lateral: i32, turning: i32, steered: i32) -> None:
    """Note whether the unit last turned to a side away from where the car was steered to.

    In a slide with countersteer it is the steering that changes its side.
    """
    side: i32 = side_of(lateral, turning, cal.mirror_min)
    if side != 0 and side != ecu.unit_side:
        ecu.unit_away = side_of(lateral, -steered, 0) & 1
        ecu.unit_side = side
    if magnitude(lateral) <= cal.mirror_min and magnitude(turning) <= cal.mirror_min:
        ecu.unit_side = 0


def watch_mirror_image(ecu: Ecu, cal: Calibration, turning: i32) -> None:
    """Judge whether lateral acceleration and yaw rate are what steering gives, or its negative."""
    lateral: i32 = ecu.lateral_acceleration
    slow: i32 = low_pass(ecu, STEERED, ecu.steering_acceleration, cal.redundancy_pass[FOLLOWING])
    watch_side(ecu, cal, lateral, turning, slow)
    if ecu.unit_away == 0:
        ecu.passed[MIRRORED] = 0
        return
    to_it: i32 = clamp(magnitude(turning - slow), 0, magnitude(lateral - slow))
    to_mirror: i32 = clamp(magnitude(turning + slow), magnitude(lateral + slow), STATE_MAX)
    nearer: i32 = sat31(to_it - to_mirror - rsh(to_mirror, 1))
    mirrored: i32 = low_pass(ecu, MIRRORED, nearer, cal.redundancy_pass[AVERAGING])
    if mirrored > cal.mirror_min and ecu.motion_peak < cal.mirror_limit:
        judge(ecu, MIRROR, 1, 1)


def watch_redundancy(ecu: Ecu, cal: Calibration) -> None:
    """Judge each new sample of the inertial measurement while the car moves."""
    if cal.redundancy_min == 0 or cal.observer == BYPASS:
        return
    if (ecu.fresh[RX_IMU] & FIRST_FRAME) == 0 or ecu.gain_factor == 0:
        return
    bound: i32 = 0
    if magnitude(ecu.x[GYRO_BIAS]) >= cal.bias_max:
        bound = 1
    judge(ecu, BIAS, bound, cal.bound_samples)
    if ecu.motion_lost == 0 and (ecu.valid[RX_IMU] & LATERAL_AND_YAW) == LATERAL_AND_YAW:
        turning: i32 = product(ecu.speed, ecu.yaw_rate, 23)
        watch_lateral_acceleration(ecu, cal, turning)
        watch_mirror_image(ecu, cal, turning)
