"""Suspensions of the axles: one against the other, and what both carry together.

The body is rigid in roll, so that its suspensions roll by different angles only as far as their
tyres do. Those carry what springs, dampers and actuator of their axle pass on, and the lateral
force at its roll centre: of the lateral acceleration and, with opposite signs, of the yaw
acceleration. Mass and height of the body are not in this balance, by far the largest terms of that
of :mod:`canroll.firmware.monitors.response`, nor is a road that tilts both axles. What is left of
it is the difference between true and reported moments of one axle less that of the other, in N·m at
the front axle. It is washed out and low-passed as there, and rests with it, and once the tyres have
left their linear range: a wheel off the road bears no more load. Springs, dampers and tyres bear no
more than what acts, so that what the model may be wrong by is a share of the lateral force and of
the moments, washed out alike; and what a rough road makes, which tilts one axle after the other: by
as much as the suspensions have lately moved apart in a short time. Where that is much nothing is
judged, for wheels leave the ground.

Corners that push both sides of an axle alike make no moment, and no command asks for them. But the
springs of both axles together carry the body's weight, whatever its load transfer to the front,
rear or side: what they carry more or less for long is what other corners bear. A road over hill and
dale does that too, as little as its vertical curvature makes of the weight; on a rough one samples
of stroke rates that come late, twice or not at all add up. What they carried at the start, and all
that changes slowly, does not count.
"""

from canroll.firmware.calibration import Q_SHARE, STATE_MAX, Calibration
from canroll.firmware.fixed_point import magnitude, product, shifted
from canroll.firmware.monitors.residual import (
    AXLES,
    CENTRES,
    FRONT,
    HEAVE,
    HEAVE_STEPS,
    REAR,
    YAW,
    balance,
    change,
    deflect,
    high_pass,
    judge_axles,
    mean_step,
    peak_hold,
    start_balance,
)
from canroll.firmware.monitors.rolling import within
from canroll.firmware.state import Ecu
from canroll.firmware.subset import i32, i64, rsh, sat31


def comparable(ecu: Ecu, cal: Calibration) -> i32:
    """Return 1 where all that acts on the tyres is known, and they answer linearly."""
    if ecu.response_known == 0:
        return 0
    # a balance that starts amid a manoeuvre doubles its errors: it starts well below the limit
    below: i32 = rsh(cal.axles_limit, 2) * (1 - ecu.axles_known)
    return within(ecu, cal.axles_limit - below)


def watch_axles(ecu: Ecu, cal: Calibration) -> None:
    """Judge by the newest samples what acts on the tyres, after the body's balance."""
    if comparable(ecu, cal) == 0:
        ecu.axles_known = 0
        return
    front: i32 = product(ecu.stroke_rate[0] - ecu.stroke_rate[1], cal.axles_stretch[0], 23)
    rear: i32 = product(ecu.stroke_rate[2] - ecu.stroke_rate[3], cal.axles_stretch[1], 23)
    stretched: i32 = sat31(front - rear)
    damping: i32 = shifted(front * cal.axles_damping[0] - rear * cal.axles_damping[1], 10)
    of_rear: i32 = product(ecu.delivered[1], cal.axles_rear, 28)
    lateral: i32 = product(ecu.lateral_acceleration, cal.axles_lateral, 20)
    momentum: i32 = product(ecu.yaw_rate, cal.axles_yaw, 23)
    acting: i32 = sat31(damping + lateral + of_rear - ecu.delivered[0])
    by_lateral: i32 = product(ecu.lateral_acceleration, cal.axles_side, 20)
    wash: i32 = cal.response_wash[2]
    if ecu.axles_known == 0:
        ecu.axles_known = 1
        start_balance(ecu, AXLES, acting)
        ecu.passed[YAW] = momentum
        ecu.past[CENTRES] = by_lateral
        ecu.past[FRONT] = ecu.delivered[0]
        ecu.past[REAR] = of_rear
    yawing: i32 = change(ecu, YAW, momentum, cal.response_pass)
    mismatch: i32 = sat31(balance(ecu, cal, AXLES, acting, wash) + yawing)
    deflect(ecu, AXLES, stretched)
    by_side: i32 = magnitude(high_pass(ecu, CENTRES, by_lateral, wash))
    # what axles do to opposite sides may be wrong to one
    own: i32 = magnitude(high_pass(ecu, FRONT, ecu.delivered[0], wash))
    other: i32 = magnitude(high_pass(ecu, REAR, of_rear, wash))
    shares: i64 = cal.response_share[5] * (own + other)
    shares += cal.axles_rough * magnitude(stretched)
    uncertainty: i32 = sat31(shifted(shares, Q_SHARE) + by_side)
    bound: i32 = peak_hold(ecu.bound[AXLES], uncertainty, rsh(wash, 1))
    ecu.bound[AXLES] = bound
    if bound > cal.axles_rest:
        bound = STATE_MAX - cal.axles_min
    judge_axles(ecu, AXLES, mismatch, bound + cal.axles_min, cal.axles_ticks)


def watch_heave(ecu: Ecu, cal: Calibration) -> None:
    """Judge by the newest stroke rates what the springs carry, after the body's balance."""
    if cal.heave_min == 0:
        return
    if ecu.response_known == 0:
        start_balance(ecu, HEAVE, 0)
        ecu.past[HEAVE_STEPS] = 0
        ecu.evidence[HEAVE] = 0
        return
    front: i32 = product(ecu.stroke_rate[0] + ecu.stroke_rate[1], cal.heave_stretch[0], 23)
    rear: i32 = product(ecu.stroke_rate[2] + ecu.stroke_rate[3], cal.heave_stretch[1], 23)
    moved: i32 = sat31(front + rear)
    more: i32 = balance(ecu, cal, HEAVE, 0, cal.response_wash[1])
    deflect(ecu, HEAVE, moved)
    mean: i32 = mean_step(ecu, cal, HEAVE, HEAVE_STEPS, moved)
    late: i32 = product(mean, cal.heave_late, 10)
    judge_axles(ecu, HEAVE, more, sat31(cal.heave_min + late), cal.heave_ticks)
