"""An inertial unit that is reversed as a whole, or late by half an oscillation of the steering.

Its lateral acceleration and yaw rate agree, so that no residual of theirs tells. Both are wrong
where they are nearer to the negative of what steering angle and speed give than to it, once the
unit has turned to a side away from where the car was steered to: in a slide with countersteer it is
the steering that changes its side. The steering angle may be what is reversed: which of them is
wrong it does not tell. A finding lasts until the next ``init``.
"""

from firmware.calibration import STATE_MAX, Calibration
from firmware.fixed_point import product
from firmware.monitors.persistence import magnitude, side_of
from firmware.state import FIRST_FRAME, RX_IMU, Ecu
from firmware.subset import clamp, i32, rsh, sat31

# bits of ecu.valid of an Imu frame: lateral acceleration and yaw rate
LATERAL_AND_YAW = 6
# the largest motion fades by this power of two a sample: in 20 s
FADING = 11
# low-passes: the motion follows steering in 0.08 s, and 0.16 s are averaged
FOLLOWING = 3
AVERAGING = 4


def opposite(one: i32, other: i32) -> i32:
    """Return 1 where the two have opposite signs."""
    if one > 0 and other < 0:
        return 1
    if one < 0 and other > 0:
        return 1
    return 0


def watch_side(ecu: Ecu, cal: Calibration, lateral: i32, turning: i32) -> None:
    """Note whether the unit last turned to a side away from where the car was steered to."""
    side: i32 = side_of(lateral, turning, cal.mirror_min)
    if side != 0 and side != ecu.unit_side:
        ecu.unit_away = opposite(lateral, ecu.steered_slow)
        ecu.unit_side = side
    if magnitude(lateral) <= cal.mirror_min and magnitude(turning) <= cal.mirror_min:
        ecu.unit_side = 0


def watch_mirror(ecu: Ecu, cal: Calibration) -> None:
    """Judge each new sample of the inertial unit while the car moves, and note its motion."""
    if (ecu.fresh[RX_IMU] & FIRST_FRAME) == 0 or ecu.gain_factor == 0 or ecu.motion_lost == 1:
        return
    if (ecu.valid[RX_IMU] & LATERAL_AND_YAW) != LATERAL_AND_YAW or cal.mirror_min == 0:
        return
    lateral: i32 = ecu.lateral_acceleration
    turning: i32 = product(ecu.speed, ecu.yaw_rate, 23)
    motion: i32 = clamp(magnitude(turning), magnitude(ecu.steering_acceleration), STATE_MAX)
    ecu.motion_peak = clamp(motion, ecu.motion_peak - rsh(ecu.motion_peak, FADING), STATE_MAX)
    slow: i32 = ecu.steered_slow
    slow = sat31(slow + rsh(ecu.steering_acceleration - slow, FOLLOWING))
    ecu.steered_slow = slow
    watch_side(ecu, cal, lateral, turning)
    if ecu.unit_away == 0:
        ecu.mirrored = 0
        return
    to_it: i32 = clamp(magnitude(turning - slow), 0, magnitude(lateral - slow))
    to_mirror: i32 = clamp(magnitude(turning + slow), magnitude(lateral + slow), STATE_MAX)
    nearer: i32 = sat31(to_it - to_mirror - rsh(to_mirror, 1))
    ecu.mirrored = sat31(ecu.mirrored + rsh(nearer - ecu.mirrored, AVERAGING))
    if ecu.mirrored > cal.mirror_min and ecu.motion_peak < cal.mirror_limit:
        ecu.motion_contradicted = 1
