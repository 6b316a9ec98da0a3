"""Residuals: what is left of an equation that is zero where car, sensors and actuators are sound.

Each is filtered, compared with a bound and counted while it is beyond it to one side; one that has
been for its time accuses what :data:`ACCUSES` names, until the next ``init``. The bound rises at
once with what the model may be wrong by, and fades. A balance of moments is washed out, so that no
offset counts, and low-passed, so that the momentum enters without a derivative; what springs take
up is integrated from stroke rates. A balance of one part alone is that part, passed alike: what it
may be wrong by is a share of it.
"""

from canroll.firmware.calibration import ONE, Q_SHARE, STATE_MAX, Calibration
from canroll.firmware.fixed_point import magnitude, product
from canroll.firmware.plausibility import BAD_ACCELERATION
from canroll.firmware.state import Ecu
from canroll.firmware.subset import byte, clamp, i32, rsh, sat31, u8

# residuals, rows of ecu.evidence and, as filters, of ecu.past, ecu.passed and ecu.bound: of the
# body, quick; of the lateral acceleration, slow; one axle less the other; what the springs carry
BODY = 0
LATERAL = 1
AXLES = 2
HEAVE = 3
# what that of the lateral acceleration has left over for the moments; the roll rate by both axles
STEADY = 4
ROLLING = 5
# filters alone: what acts on the body, part by part; moment and roll rate of each axle
SPRINGS = 6
DAMPERS = 7
ACTUATORS = 8
SIDE_FORCE = 9
FRONT = 10
REAR = 11
# low-passed alone: momentum by yaw rate; a_y by steering, and how much nearer to its mirror image
YAW = 12
STEERED = 13
MIRRORED = 14
# washed out alone: at the roll centres; steps of what dampers make and of what springs carry
CENTRES = 12
DAMPER_STEPS = 13
HEAVE_STEPS = 14
# residuals of another kind, rows of ecu.evidence
APART = 6
SLIDE = 7
MIRROR = 8
BIAS = 9
STANDING = 10
DELIVERY = 11
MODEL = 13
ECHO = 14
CALM = 15

# bits of ecu.contradicted that a residual sets, by row: 1 the roll rate, 2 the lateral
# acceleration, 4 the inertial unit, 8 and 16 front and rear axle: a balance does not tell which
ACCUSES: tuple[u8, ...] = (24, 2, 24, 24, 24, 1, 2, 2, 4, 1, 1, 8, 16, 0, 0, 0)


def low_pass(ecu: Ecu, row: i32, value: i32, weight: i32) -> i32:
    """Return ``value`` low-passed: it follows by ``weight``, of 2^30."""
    passed: i32 = ecu.passed[row]
    passed = sat31(passed + product(value - passed, weight, 30))
    ecu.passed[row] = passed
    return passed


def peak_hold(last: i32, value: i32, fading: i32) -> i32:
    """Return ``value``, or ``last`` where that is more, faded by ``fading`` of 2^30."""
    return clamp(value, last - rsh(last * fading, 30), STATE_MAX)


def high_pass(ecu: Ecu, row: i32, value: i32, wash: i32) -> i32:
    """Return what is new in ``value``: washed out by ``wash``, of 2^30."""
    new: i32 = sat31(value - ecu.past[row])
    ecu.past[row] = sat31(ecu.past[row] + product(new, wash, 30))
    return new


def change(ecu: Ecu, row: i32, value: i32, weight: i32) -> i32:
    """Return how far ``value`` is ahead of itself low-passed: its rate by the time constant."""
    return sat31(value - low_pass(ecu, row, value, weight))


def balance(ecu: Ecu, cal: Calibration, row: i32, acting: i32, wash: i32) -> i32:
    """Return what is left of a balance but for the momentum, washed out and low-passed."""
    new: i32 = high_pass(ecu, row, acting, wash)
    return low_pass(ecu, row, new, cal.response_pass)


def deflect(ecu: Ecu, row: i32, stretched: i32) -> None:
    """Let the springs of a balance take up ``stretched`` until the next tick."""
    ecu.past[row] = sat31(ecu.past[row] - stretched)


def start_balance(ecu: Ecu, row: i32, acting: i32) -> None:
    """Start a balance from what acts: nothing is left over now."""
    ecu.past[row] = acting
    ecu.passed[row] = 0
    ecu.bound[row] = 0


def share(value: i32, of: i32) -> i32:
    """Return a share ``of`` the magnitude of ``value``."""
    return product(magnitude(value), of, Q_SHARE)


def mean_step(ecu: Ecu, cal: Calibration, row: i32, steps: i32, value: i32) -> i32:
    """Return the mean magnitude by which an input changes in a tick; ``value`` is the newest.

    What samples that come early, late, twice or not at all are wrong by follows it.
    """
    # it starts low: until it is known the shares of springs, dampers and unequal strokes on such a
    # road, and the least force for heave, are more than what adds up
    step: i32 = magnitude(high_pass(ecu, steps, value, ONE))
    mean: i32 = ecu.bound[row]
    fading: i32 = rsh(mean * cal.response_mean, 30)
    mean = clamp(mean - fading + rsh(step * cal.response_mean, 30), 0, STATE_MAX)
    ecu.bound[row] = mean
    return mean


def gap(value: i32, one: i32, other: i32) -> i32:
    """Return by how much ``value`` is outside the interval between ``one`` and ``other``."""
    high: i32 = clamp(one, other, STATE_MAX)
    low: i32 = clamp(one, -STATE_MAX, other)
    return clamp(value - high, clamp(low - value, 0, STATE_MAX), STATE_MAX)


def side_of(one: i32, other: i32, least: i32) -> i32:
    """Return 1 where both exceed ``least``, -1 where both are below its negative, else 0."""
    if one > least and other > least:
        return 1
    if one < -least and other < -least:
        return -1
    return 0


def beyond(size: i32, bound: i32) -> i32:
    """Return 1 for a size beyond ``bound``, 2 beyond its double, which needs half the time."""
    if size > bound + bound:
        return 2
    if size > bound:
        return 1
    return 0


def judge(ecu: Ecu, row: i32, bad: i32, time: i32) -> i32:
    """Count what is ``bad`` without a break; after ``time`` accuse by the row and return 1."""
    if bad == 0:
        ecu.evidence[row] = 0
        return 0
    count: i32 = clamp(ecu.evidence[row] + bad, 0, time)
    ecu.evidence[row] = count
    if count != time:
        return 0
    ecu.contradicted = byte(ecu.contradicted | ACCUSES[row])
    return 1


def judge_axles(ecu: Ecu, row: i32, mismatch: i32, bound: i32, time: i32) -> None:
    """Judge a balance of moments to one side: what bounces changes it before.

    Nothing is bad while the lateral acceleration is.
    """
    side: i32 = 0
    if mismatch < 0:
        side = 1
    if side != ecu.side[row]:
        ecu.side[row] = byte(side)
        ecu.evidence[row] = 0
    bad: i32 = beyond(magnitude(mismatch), bound)
    if ecu.bad_ticks[BAD_ACCELERATION] > 0:
        bad = 0
    judge(ecu, row, bad, time)
