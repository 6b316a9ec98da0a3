"""Balances of the moments on the body or an axle: what is left over is not what was reported.

What springs take up is integrated from stroke rates. All of a balance is washed out, so that no
offset counts, and low-passed, so that the momentum enters without a derivative. A balance of one
part alone is that part, passed alike: what it may be wrong by is a share of it.
"""

from firmware.calibration import ONE, Q_SHARE, STATE_MAX, Calibration
from firmware.fixed_point import magnitude, product
from firmware.monitors.redundancy import beyond, lasting
from firmware.plausibility import BAD_ACCELERATION
from firmware.state import Ecu
from firmware.subset import clamp, i32, rsh, sat31

# the balances: of the body by the lateral acceleration, of one axle less the other
LATERAL = 0
AXLES = 1
# of what the springs carry, upright
HEAVE = 2
# what the lateral acceleration's has left over for the moments
STEADY = 3
# of the body, and what acts on it, part by part: the quick ones
BODY = 4
SIDE_FORCE = 5
SPRINGS = 6
DAMPERS = 7
ACTUATORS = 8
# values of ecu.response_known: neither balance is judged, that of the moments, both
NOTHING = 0
ONE_BALANCE = 1
BOTH = 2


def start_balance(ecu: Ecu, which: i32, acting: i32, momentum: i32) -> None:
    """Start a balance from what acts: nothing is left over now."""
    ecu.balance_spring[which] = sat31(-acting)
    ecu.balance_slow[which] = sat31(-momentum)
    ecu.balance_past[which] = 0
    ecu.balance_uncertainty[which] = 0


def washout(ecu: Ecu, cal: Calibration, which: i32) -> i32:
    """Return what goes of a balance in a tick; the slow ones are quick until they are judged."""
    if which >= BODY:
        return cal.response_wash[0]
    if which == AXLES:
        return cal.response_wash[2]
    if which != HEAVE and ecu.response_known != BOTH:
        return cal.response_wash[0]
    return cal.response_wash[1]


def residual(ecu: Ecu, cal: Calibration, which: i32, acting: i32, momentum: i32) -> i32:
    """Return what is left of a balance, washed out and low-passed.

    ``acting`` is all but the springs' share, ``momentum`` by the low-pass's time constant.
    """
    wash: i32 = washout(ecu, cal, which)
    spring: i32 = ecu.balance_spring[which]
    slow: i32 = ecu.balance_slow[which]
    washed: i32 = sat31(spring + acting)
    ecu.balance_spring[which] = sat31(spring - product(washed, wash, 30))
    slow = sat31(slow + product(sat31(washed - momentum - slow), cal.response_pass, 30))
    ecu.balance_slow[which] = slow
    return sat31(slow + momentum)


def deflect(ecu: Ecu, which: i32, stretched: i32) -> None:
    """Let the springs of a balance take up ``stretched`` until the next tick."""
    ecu.balance_spring[which] = sat31(ecu.balance_spring[which] + stretched)


def high_pass(ecu: Ecu, which: i32, value: i32, fading: i32) -> i32:
    """Return what is new in ``value``: washed out by ``fading``, of 2^30."""
    new: i32 = sat31(value - ecu.balance_past[which])
    ecu.balance_past[which] = sat31(ecu.balance_past[which] + product(new, fading, 30))
    return new


def share(value: i32, of: i32) -> i32:
    """Return a share ``of`` the magnitude of ``value``."""
    return product(magnitude(value), of, Q_SHARE)


def raise_threshold(ecu: Ecu, which: i32, size: i32, fading: i32) -> None:
    """Let what may be left over follow ``size`` up at once and fade by ``fading``, of 2^30."""
    uncertainty: i32 = ecu.balance_uncertainty[which]
    ecu.balance_uncertainty[which] = clamp(
        size, uncertainty - product(uncertainty, fading, 30), STATE_MAX
    )


def mean_change(ecu: Ecu, cal: Calibration, which: i32, value: i32) -> i32:
    """Return the mean magnitude by which an input changes in a tick; ``value`` is the newest.

    What samples that come early, late, twice or not at all are wrong by follows it.
    """
    # it starts low: until it is known the shares of springs, dampers and unequal strokes on such a
    # road, and the least force for heave, are more than what adds up
    change: i32 = magnitude(high_pass(ecu, which, value, ONE))
    mean: i32 = ecu.balance_uncertainty[which]
    fading: i32 = rsh(mean * cal.response_mean, 30)
    mean = clamp(mean - fading + rsh(change * cal.response_mean, 30), 0, STATE_MAX)
    ecu.balance_uncertainty[which] = mean
    return mean


def accuse_axles(ecu: Ecu, which: i32, mismatch: i32, limit: i32, ticks: i32) -> None:
    """Believe no axle once the ``mismatch`` has been beyond ``limit`` to one side for so long.

    The balance does not tell which lies. What bounces changes its side before. Ticks to the
    negative side count as negative, and none while the lateral acceleration is bad.
    """
    most: i32 = limit
    if ecu.bad_ticks[BAD_ACCELERATION] > 0:
        most = STATE_MAX
    side: i32 = 1
    if mismatch < 0:
        side = -1
    so_far: i32 = clamp(sat31(side * ecu.balance_ticks[which]), 0, ticks)
    count: i32 = lasting(so_far, beyond(magnitude(mismatch), most), ticks)
    ecu.balance_ticks[which] = sat31(side * count)
    if count == ticks:
        ecu.contradicted[0] = 1
        ecu.contradicted[1] = 1
