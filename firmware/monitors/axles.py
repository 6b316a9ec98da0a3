"""One axle's suspension against the other's, for an axle that reports what it does not do.

The body is rigid in roll, so that its suspensions roll by different angles only as far as their
tyres do. Those carry what springs, dampers and actuator of their axle pass on, and the lateral
force at its roll centre: of the lateral acceleration and, with opposite signs, of the yaw
acceleration. Mass and height of the body are not in this balance, by far the largest terms of that
of :mod:`firmware.monitors.response`, nor is a road that tilts both axles. What is left of it is the
difference between true and reported moments of one axle less that of the other, in N·m at the
front axle. It is washed out and low-passed as there, and rests with it, and once the tyres have
left their linear range: a wheel off the road bears no more load. Springs, dampers and tyres bear no
more than what acts, so that what the model may be wrong by is a share of the lateral force and of
the moments, washed out alike; and what a rough road makes,
which tilts one axle after the other: by as much as the suspensions have lately moved apart in a
short time. Where that is much nothing is judged, for wheels leave the ground. Which axle lies it
does not tell. A finding lasts until the next ``init``.
"""

from firmware.calibration import Q_SHARE, STATE_MAX, Calibration
from firmware.fixed_point import magnitude, product, shifted
from firmware.monitors.balance import (
    ACTUATORS,
    AXLES,
    SIDE_FORCE,
    accuse_axles,
    deflect,
    high_pass,
    raise_threshold,
    residual,
    start_balance,
)
from firmware.monitors.rolling import within
from firmware.state import Ecu
from firmware.subset import i32, i64, rsh, sat31


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
    if ecu.axles_known == 0:
        ecu.axles_known = 1
        start_balance(ecu, AXLES, acting, momentum)
        ecu.balance_past[AXLES] = by_lateral
        ecu.balance_past[ACTUATORS] = ecu.delivered[0]
        ecu.balance_past[SIDE_FORCE] = of_rear
    mismatch: i32 = residual(ecu, cal, AXLES, acting, momentum)
    deflect(ecu, AXLES, stretched)
    wash: i32 = cal.response_wash[2]
    by_side: i32 = magnitude(high_pass(ecu, AXLES, by_lateral, wash))
    # what axles do to opposite sides may be wrong to one
    own: i32 = magnitude(high_pass(ecu, ACTUATORS, ecu.delivered[0], wash))
    other: i32 = magnitude(high_pass(ecu, SIDE_FORCE, of_rear, wash))
    shares: i64 = cal.response_share[5] * (own + other)
    shares += cal.axles_rough * magnitude(stretched)
    uncertainty: i32 = sat31(shifted(shares, Q_SHARE) + by_side)
    raise_threshold(ecu, AXLES, uncertainty, rsh(wash, 1))
    limit: i32 = ecu.balance_uncertainty[AXLES] + cal.axles_min
    if ecu.balance_uncertainty[AXLES] > cal.axles_rest:
        limit = STATE_MAX
    accuse_axles(ecu, AXLES, mismatch, limit, cal.axles_ticks)
