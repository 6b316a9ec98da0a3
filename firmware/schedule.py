"""Speed schedule: gain factor, front share and steering gain, and the fade at walking pace."""

from canroll.firmware.calibration import ONE, STATE_MAX, Calibration
from canroll.firmware.fixed_point import product, quotient
from canroll.firmware.state import RX_VEHICLE_MOTION, Ecu
from canroll.firmware.subset import clamp, i32, sat31

Q28_ONE = 1 << 28


def between(low: i32, high: i32, share: i32) -> i32:
    """Return the value a ``share`` (Q28, 0 to 1) of the way from ``low`` to ``high``."""
    return sat31(low + product(high - low, share, 28))


def ratio(numerator: i32, denominator: i32) -> i32:
    """Return a quotient (Q28), at most 1; ``numerator`` >= 0 and ``denominator`` > 0."""
    # beyond the ends, where a car mostly is, nothing needs to be divided
    if numerator == 0:
        return 0
    if numerator >= denominator:
        return Q28_ONE
    return clamp(quotient(numerator * Q28_ONE, denominator), 0, Q28_ONE)


def schedule(ecu: Ecu, cal: Calibration) -> None:
    """Interpolate the schedule at a motion just received, constant beyond its ends."""
    if ecu.fresh[RX_VEHICLE_MOTION] == 0:
        return
    point: i32 = 0
    for k in range(1, cal.schedule_points):
        if ecu.speed >= cal.schedule_speed[k]:
            point = k
    after: i32 = clamp(point + 1, 0, cal.schedule_points - 1)
    width: i32 = clamp(cal.schedule_speed[after] - cal.schedule_speed[point], 1, STATE_MAX)
    gone: i32 = clamp(ecu.speed - cal.schedule_speed[point], 0, STATE_MAX)
    share: i32 = ratio(gone, width)
    gain: i32 = between(cal.schedule_gain[point], cal.schedule_gain[after], share)
    front: i32 = between(cal.schedule_front_share[point], cal.schedule_front_share[after], share)
    ecu.front_share = clamp(front, 0, ONE)
    steering: i32 = between(cal.schedule_steering[point], cal.schedule_steering[after], share)
    ecu.steering_acceleration = product(steering, ecu.steering, 20)
    span: i32 = clamp(cal.fade_high - cal.fade_low, 1, STATE_MAX)
    beyond_low: i32 = clamp(ecu.speed - cal.fade_low, 0, STATE_MAX)
    fade: i32 = ratio(beyond_low, span)
    ecu.gain_factor = clamp(product(gain, fade, 28), 0, ONE)
