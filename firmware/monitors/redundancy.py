"""Analytic redundancy: each motion sensor against what the others and the roll dynamics predict.

With a the lateral specific force, s the roll of the body on its suspension by the stroke rates, p
the roll rate and M the delivered moment, the body obeys m h a = K s + C s' + I p' - M, whatever
bank, grip and sideslip; body and suspension roll differ by the tyres' deflection alone. Angles are
leaky integrals, so that biases do not add up, and the other terms lose their slow mean likewise.
Thresholds rise with motion and roughness; where two of three accelerations say that the car is near
its limit, where wheels lift, the residuals mean nothing and start anew.
"""

from firmware.calibration import BYPASS, STATE_MAX, Calibration
from firmware.fixed_point import product
from firmware.observer import acting_moment
from firmware.plausibility import (
    BAD_ACCELERATION,
    BAD_ROLL_RATE,
    BAD_STROKE,
    FAULT_ACTUATOR_CONTRADICTED,
    FAULT_LATERAL_CONTRADICTED,
    FAULT_ROLL_RATE_CONTRADICTED,
    FAULT_STROKE_CONTRADICTED,
)
from firmware.state import AGE_MAX, RX_IMU, RX_SUSPENSION_RATE, Ecu
from firmware.subset import byte, clamp, i32, i64, rsh, sat31

# residuals: indices of ecu.strikes
TURN = 0
RESPONSE = 1
WARP = 2


def magnitude(value: i32) -> i32:
    """Return the magnitude of ``value``, at most ``STATE_MAX``."""
    if value < 0:
        return clamp(-value, 0, STATE_MAX)
    return clamp(value, 0, STATE_MAX)


def envelope(last: i32, value: i32, shift: i32) -> i32:
    """Return the envelope of a magnitude: it rises at once and decays by 2**-shift a sample."""
    kept: i32 = last - rsh(last, shift)
    if value > kept:
        return value
    return kept


def larger(a: i32, b: i32) -> i32:
    """Return the larger of two."""
    if a > b:
        return a
    return b


def nearer(mean: i32, value: i32, shift: i32) -> i32:
    """Return the low-passed ``mean`` a sample later."""
    return sat31(mean + rsh(value - mean, shift))


def median(a: i32, b: i32, c: i32) -> i32:
    """Return the second largest of three, which a single wrong one never decides."""
    if a > b:
        return clamp(c, b, a)
    return clamp(c, a, b)


def severity(ecu: Ecu, cal: Calibration, explained: i32, lateral: i32, turning: i32) -> i32:
    """Return the acceleration that says how near its limit the car is: the second of three.

    Beyond the limit the roll dynamics explain nothing, and the larger of the other two counts,
    until both are small again.
    """
    if ecu.near_limit > cal.monitor_limit:
        return larger(lateral, turning)
    return median(explained, lateral, turning)


def leaky(cal: Calibration, angle: i32, rate: i32, shift: i32) -> i32:
    """Return the leaky integral ``angle`` of ``rate`` (both Q27) a sample later."""
    gained: i32 = product(rate, cal.monitor_step, 30)
    return sat31(angle + gained - rsh(angle, shift))


def strike(ecu: Ecu, cal: Calibration, residual: i32, size: i32, threshold: i32) -> i32:
    """Count samples in a row beyond the threshold; return 1 from the last that is needed on."""
    count: i32 = 0
    if magnitude(size) > threshold:
        count = clamp(ecu.strikes[residual] + 1, 0, cal.monitor_samples)
    ecu.strikes[residual] = byte(count)
    if count == cal.monitor_samples:
        return 1
    return 0


def rest(ecu: Ecu, lateral: i32, force: i32) -> None:
    """Start all residuals from zero at the present operating point."""
    ecu.stroke_roll = 0
    ecu.turn_roll = 0
    ecu.warp_roll = 0
    ecu.response = 0
    ecu.rate_smooth = ecu.roll_rate
    ecu.force_mean = force
    ecu.lateral_mean = lateral
    for residual in range(3):
        ecu.strikes[residual] = 0


def judge(ecu: Ecu, cal: Calibration, turn: i32, response: i32, turning: i32) -> None:
    """Compare the residuals with their thresholds and name the cause.

    An acceleration that is wrong and a moment that does not act look alike to the roll dynamics:
    the product of yaw rate and speed, ``turning``, tells which of both explains the residual.
    """
    limit: i32 = sat31(cal.warp_min + rsh(ecu.rough, 4))
    warped: i32 = strike(ecu, cal, WARP, ecu.warp_roll, limit)
    tilt: i32 = product(ecu.size, cal.monitor_tyre, 27)
    limit = sat31(cal.turn_min + tilt + rsh(tilt, 2) + rsh(ecu.rough, 5))
    turned: i32 = strike(ecu, cal, TURN, turn, limit)
    limit = sat31(cal.response_min + rsh(ecu.size, 2) + rsh(ecu.size, 4))
    limit = sat31(limit + product(ecu.rough, cal.response_rough, 23))
    answered: i32 = strike(ecu, cal, RESPONSE, response, limit)
    if warped == 1:
        ecu.accused = ecu.accused | (1 << FAULT_STROKE_CONTRADICTED)
        return
    if turned == 1:
        ecu.accused = ecu.accused | (1 << FAULT_ROLL_RATE_CONTRADICTED)
    if answered == 1:
        apart: i32 = sat31(ecu.lateral_acceleration - turning)
        if magnitude(sat31(apart - response)) < magnitude(apart):
            ecu.accused = ecu.accused | (1 << FAULT_LATERAL_CONTRADICTED)
        else:
            ecu.accused = ecu.accused | (1 << FAULT_ACTUATOR_CONTRADICTED)


def roughness(ecu: Ecu, warp: i32) -> i32:
    """Return the larger magnitude of the axles' difference in roll rate and the heave rate."""
    heave: i64 = ecu.stroke_rate[0] + ecu.stroke_rate[1] + ecu.stroke_rate[2] + ecu.stroke_rate[3]
    return larger(magnitude(warp), magnitude(sat31(rsh(heave, 2))))


def compare(ecu: Ecu, cal: Calibration) -> None:
    """Advance the residuals by one sample of the inertial measurement, and judge them."""
    front: i32 = product(ecu.stroke_rate[0] - ecu.stroke_rate[1], cal.arm_front, 28)
    rear: i32 = product(ecu.stroke_rate[2] - ecu.stroke_rate[3], cal.arm_rear, 28)
    warp: i32 = sat31(front - rear)
    rate: i32 = sat31(rsh(front + rear, 1))
    ecu.stroke_roll = leaky(cal, ecu.stroke_roll, rate, cal.response_shift)
    damped: i32 = product(rate, cal.monitor_damping, 23)
    carried: i32 = product(ecu.stroke_roll, cal.monitor_stiffness, 23)
    pushed: i32 = product(acting_moment(ecu, cal), cal.monitor_moment, 26)
    explained: i32 = sat31(carried + damped - pushed)
    lateral: i32 = ecu.lateral_acceleration
    if ecu.lateral_lost == 1:
        # the gyro is still checked, by strokes and moment alone
        lateral = explained
    force: i32 = sat31(lateral - damped + pushed)
    turning: i32 = product(ecu.speed, ecu.yaw_rate, 23)
    nearly: i32 = severity(ecu, cal, magnitude(explained), magnitude(lateral), magnitude(turning))
    ecu.near_limit = envelope(ecu.near_limit, nearly, 7)
    size: i32 = sat31(magnitude(carried) + magnitude(damped))
    size = larger(size, larger(magnitude(pushed), magnitude(lateral)))
    ecu.size = envelope(ecu.size, size, 5)
    ecu.rough = envelope(ecu.rough, roughness(ecu, warp), 6)
    if ecu.near_limit > cal.monitor_limit or unsteady(ecu, cal) == 1:
        rest(ecu, lateral, force)
        return

    ecu.turn_roll = leaky(cal, ecu.turn_roll, sat31(ecu.roll_rate - rate), cal.turn_shift)
    ecu.warp_roll = leaky(cal, ecu.warp_roll, warp, cal.turn_shift)
    ecu.lateral_mean = nearer(ecu.lateral_mean, lateral, cal.turn_shift)
    ecu.force_mean = nearer(ecu.force_mean, force, cal.response_shift)
    ecu.rate_smooth = nearer(ecu.rate_smooth, ecu.roll_rate, 2)
    ecu.response = nearer(ecu.response, sat31(force - ecu.force_mean - carried), 2)
    tilted: i32 = product(lateral - ecu.lateral_mean, cal.monitor_tyre, 27)
    rolling: i32 = product(ecu.roll_rate - ecu.rate_smooth, cal.monitor_inertia, 23)
    judge(ecu, cal, sat31(ecu.turn_roll - tilted), sat31(ecu.response - rolling), turning)


def unsteady(ecu: Ecu, cal: Calibration) -> i32:
    """Return 1 where samples or values are missing, or the car hardly moves."""
    if ecu.gain_factor == 0:
        return 1
    if ecu.monitor_gap > cal.monitor_gap_max:
        return 1
    if ecu.age[RX_SUSPENSION_RATE] > cal.monitor_gap_max:
        return 1
    if ecu.bad_ticks[BAD_ROLL_RATE] > 0 or ecu.bad_ticks[BAD_STROKE] > 0:
        return 1
    if ecu.bad_ticks[BAD_ACCELERATION] > 0 and ecu.lateral_lost == 0:
        return 1
    return 0


def watch_redundancy(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Compare at each sample of the inertial measurement, where the calibration has limits."""
    if cal.monitor_limit == 0 or cal.observer == BYPASS:
        return
    ecu.monitor_gap = clamp(ecu.monitor_gap + elapsed, 0, AGE_MAX)
    if ecu.fresh[RX_IMU] == 1:
        compare(ecu, cal)
        ecu.monitor_gap = 0
