"""Reported moments against the body's response, for actuators that report what they do not do.

The body rolls about its axis by what acts on it: springs and dampers, whose stroke rates are
measured, the lateral acceleration and the delivered moments. What is left of that balance is the
difference between true and reported moments, whatever the road does, for it acts through the
springs. All of it is washed out, so that no offset counts, and low-passed, so that the roll
acceleration is got from the roll rate without a derivative. What the model may be wrong by is a
share of each part of the balance, washed out and low-passed as what is left over: a mass that is
unknown excuses no more than its lateral force makes then. Where more is left to one side for a
while, no axle is believed: the sum does not tell which. A moment that runs away is a step, and
stays within what a slow change of the parts may make. So what is left over is washed out once more,
and judged by the parts washed out likewise. At the tyres' limit, where wheels lift and stops are
reached, three quarters of what the body's inertia takes may be left over besides, and a quarter of
the moments. The first samples' noise stays in the integral for a while, what a rough road makes of
samples that come late does so longer.

A wrong lateral acceleration is left over likewise, and differs from yaw rate times speed to the
same side, which no lie about moments does. As no bank enters the balance, both may be small and the
washout slow; but it starts in calm running alone. What the model may be wrong by is five eighths of
what springs, dampers and moments say of the lateral acceleration, at the tyres' limit a quarter
more than that. Its finding lasts as well.

Where yaw rate times speed does not differ from it, what is left of the slow balance is what was
reported wrongly of the moments: one that ran away stays in it, which the quicker washout forgets
once the car goes straighter. Springs take up what a moment does that is not reported, and excuse
nothing here: what the model may be wrong by is half of the lateral force, washed out as slowly, and
a quarter of the moments; until the model was seen to be about right, seven eighths of the force to
its own side. A rough road adds up in what is integrated.
"""

from firmware.calibration import ONE, STATE_MAX, Calibration
from firmware.fixed_point import product
from firmware.monitors.balance import (
    ACTUATORS,
    BODY,
    DAMPERS,
    JUMP,
    LATERAL,
    SIDE_FORCE,
    SLOWER,
    SPRINGS,
    STEADY,
    accuse_axles,
    at_once,
    leave_mean,
    leave_room,
    left_over,
    start_balance,
    stretch,
)
from firmware.monitors.redundancy import lasting, magnitude, side_of
from firmware.monitors.rolling import ROLL_SIGNAL, YAW, measured, within
from firmware.plausibility import NEEDED
from firmware.state import RX_ACTUATOR_STATE, RX_IMU, Ecu
from firmware.subset import clamp, i32, rsh, sat31

# bit of ecu.valid of an Imu frame
LATERAL_SIGNAL = 2
# what the model may be wrong by fades in 8 time constants of the low-pass
FADING = 3
# rebound and bump differ from a damper's coefficient by half of it
ROUGH = 1
# of what the dampers' moment changes in a tick, 2 to this power times the mean may be left over
RATTLING = 4
# at the start 2 to this power times the least may be left over, and it fades by as much faster
STARTING = 2
# values of ecu.response_known: neither balance, that of the moments, both
NOTHING = 0
ONE_BALANCE = 1
BOTH = 2


def known(ecu: Ecu, cal: Calibration) -> i32:
    """Return 1 where all that acts on the body is known, and the actuators follow commands."""
    moment: i32 = NEEDED[RX_ACTUATOR_STATE]
    if measured(ecu, cal) == 0:
        return 0
    if (ecu.valid[RX_IMU] & LATERAL_SIGNAL) == 0 or ecu.lateral_lost == 1:
        return 0
    if (ecu.valid[RX_ACTUATOR_STATE] & moment) != moment or ecu.moment_unknown == 1:
        return 0
    return ecu.enabled & ecu.command_held


def moment_ticks(cal: Calibration) -> i32:
    """Return how long too much has to be left over for moments that were reported wrongly."""
    return rsh(cal.response_ticks, 1) + rsh(cal.response_ticks, 3)


def slow_min(cal: Calibration) -> i32:
    """Return what the slow balance may always have left over."""
    return rsh(cal.response_min, 1) + rsh(cal.response_min, 2)


def watch_lateral_balance(ecu: Ecu, cal: Calibration, left: i32, beside: i32, shown: i32) -> None:
    """Judge the lateral acceleration by what is ``left`` and by yaw rate times speed.

    ``beside`` is by how much that differs from it, ``shown`` what suspension and moments say of it.
    """
    leave_room(ecu, LATERAL, rsh(shown, 1) + rsh(shown, 3), rsh(cal.response_pass, FADING))
    limit: i32 = ecu.balance_room[LATERAL] + slow_min(cal)
    if within(ecu, cal.response_limit) == 0:
        limit = sat31(limit + rsh(limit, 2))
    side: i32 = 0
    if ecu.motion_lost == 0 and (ecu.valid[RX_IMU] & YAW) != 0:
        side = side_of(left, beside, limit)
    ecu.balance_ticks[LATERAL] = lasting(ecu.balance_ticks[LATERAL], side & 1, cal.response_ticks)
    if ecu.balance_ticks[LATERAL] == cal.response_ticks:
        ecu.lateral_contradicted = 1


def watch_model(ecu: Ecu, cal: Calibration, by_force: i32, left: i32) -> None:
    """Note for good that the model is about right: a lateral force leaves over little for long."""
    if ecu.model_ticks == cal.response_ticks:
        return
    force: i32 = magnitude(by_force)
    right: i32 = 0
    if force > 3 * cal.response_min and magnitude(left) < rsh(force, 2):
        right = 1
    ecu.model_ticks = lasting(ecu.model_ticks, right, cal.response_ticks)


def of_force(ecu: Ecu, cal: Calibration, by_force: i32, left: i32) -> i32:
    """Return what the model may be wrong by for so much lateral force, to the side of ``left``.

    Mass and height that are larger than designed for and softer springs leave over more to its own
    side than the reverse does to the other: 1.2 * 1.2 / 0.8 - 1 against 1 - 0.8 * 0.8 / 1.2. That
    much is excused until less was seen to be left over.
    """
    force: i32 = magnitude(by_force)
    if side_of(left, by_force, 0) != 0 and ecu.model_ticks < cal.response_ticks:
        return rsh(force, 1) + rsh(force, 2) + rsh(force, 3)
    return rsh(force, 1)


def watch_steady(ecu: Ecu, cal: Calibration, left: i32, beside: i32, wrong: i32) -> None:
    """Judge the reported moments by what is ``left`` of the slow balance.

    ``beside`` as above: to the same side, it is the acceleration that may be wrong. ``wrong`` is
    what the model may be wrong by.
    """
    leave_room(ecu, STEADY, wrong, rsh(cal.response_pass, FADING))
    rattled: i32 = ecu.balance_room[DAMPERS]
    limit: i32 = sat31(ecu.balance_room[STEADY] + rattled + cal.response_min)
    if within(ecu, cal.response_limit) == 0 or side_of(left, beside, slow_min(cal)) != 0:
        limit = STATE_MAX
    accuse_axles(ecu, STEADY, left, limit, moment_ticks(cal))


def start_parts(ecu: Ecu, damping: i32, moment: i32, lateral: i32, momentum: i32) -> None:
    """Start the balance of the moments from what acts, part by part."""
    start_balance(ecu, SIDE_FORCE, lateral, 0)
    start_balance(ecu, SPRINGS, 0, 0)
    start_balance(ecu, DAMPERS, damping, 0)
    start_balance(ecu, ACTUATORS, moment, 0)
    start_balance(ecu, BODY, 0, momentum)
    start_balance(ecu, JUMP, 0, 0)


def may_be_wrong(side_force: i32, springs: i32, actuators: i32) -> i32:
    """Return what the model may be wrong by where the body is acted on by so much."""
    lateral: i32 = magnitude(side_force)
    by_force: i32 = rsh(lateral, 2) + rsh(lateral, 3)
    return sat31(by_force + rsh(magnitude(springs), 2) + rsh(magnitude(actuators), 3))


def rough(ecu: Ecu, cal: Calibration) -> i32:
    """Return what dampers may make of unequal strokes, by what rebound and bump differ.

    Where the body only rolls or heaves both sides move alike, and rebound makes up for bump.
    """
    front: i32 = magnitude(magnitude(ecu.stroke_rate[0]) - magnitude(ecu.stroke_rate[1]))
    rear: i32 = magnitude(magnitude(ecu.stroke_rate[2]) - magnitude(ecu.stroke_rate[3]))
    of_front: i32 = product(front, cal.response_stroke[0], 23 + ROUGH)
    of_rear: i32 = product(rear, cal.response_stroke[1], 23 + ROUGH)
    return sat31(of_front + of_rear)


def since_start(ecu: Ecu, cal: Calibration) -> i32:
    """Return what the noise of the first samples may leave over, and let it fade."""
    leave_room(ecu, SIDE_FORCE, 0, sat31(cal.response_wash << STARTING))
    return ecu.balance_room[SIDE_FORCE]


def watch_left_over(ecu: Ecu, cal: Calibration, left: i32, inertia: i32, bumpy: i32) -> None:
    """Judge the reported moments by what is ``left`` over, and by what is new in it.

    ``inertia`` is what the body's takes, ``bumpy`` what dampers may make of a rough road.
    """
    # a part has no momentum: it is what its low-pass holds
    side_force: i32 = ecu.balance_slow[SIDE_FORCE]
    springs: i32 = ecu.balance_slow[SPRINGS]
    actuators: i32 = ecu.balance_slow[ACTUATORS]
    besides: i32 = bumpy
    if within(ecu, cal.response_limit) == 0:
        size: i32 = magnitude(inertia)
        # stops take up what actuators give up, and no spring shows it
        by_stops: i32 = size + magnitude(actuators)
        besides = sat31(besides + rsh(size, 1) + rsh(by_stops, 2))
    fading: i32 = rsh(cal.response_pass, FADING)
    wrong: i32 = may_be_wrong(side_force, springs, actuators)
    leave_room(ecu, BODY, sat31(wrong + besides), fading)
    side_force = at_once(ecu, SIDE_FORCE, side_force, fading)
    springs = at_once(ecu, SPRINGS, springs, fading)
    actuators = at_once(ecu, ACTUATORS, actuators, fading)
    wrong = may_be_wrong(side_force, springs, actuators)
    leave_room(ecu, JUMP, sat31(wrong + besides), fading)
    new: i32 = at_once(ecu, BODY, left, fading)
    ticks: i32 = moment_ticks(cal)
    begun: i32 = since_start(ecu, cal)
    # late samples of a rough road are forgotten as slowly as all that is integrated
    least: i32 = clamp(rsh(ecu.balance_room[DAMPERS], 2), cal.response_min, STATE_MAX)
    accuse_axles(ecu, BODY, left, sat31(ecu.balance_room[BODY] + begun + least), ticks)
    accuse_axles(ecu, JUMP, new, sat31(ecu.balance_room[JUMP] + begun + cal.response_min), ticks)


def watch_response(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Judge by the newest samples what acts on the body; a missed tick breaks its integral.

    Frames come early and late, so that there are ticks with two of them and ticks with none.
    """
    if cal.response_min == 0:
        return
    if elapsed > 1 or known(ecu, cal) == 0:
        ecu.response_known = 0
        return
    if (cal.measurements & ROLL_SIGNAL) == 0:
        # axles and heave are judged without the body's momentum, its balance is not
        ecu.response_known = ONE_BALANCE
        return
    front: i32 = product(ecu.stroke_rate[0] - ecu.stroke_rate[1], cal.response_stroke[0], 23)
    rear: i32 = product(ecu.stroke_rate[2] - ecu.stroke_rate[3], cal.response_stroke[1], 23)
    damping: i32 = sat31(front + rear)
    moment: i32 = sat31(ecu.delivered[0] + ecu.delivered[1])
    lateral: i32 = product(ecu.lateral_acceleration, cal.response_lateral, 20)
    momentum: i32 = product(ecu.roll_rate, cal.response_inertia, 23)
    acting: i32 = sat31(damping - moment - lateral)
    size: i32 = sat31(magnitude(damping) + magnitude(moment) + magnitude(lateral))
    if ecu.response_known == NOTHING:
        ecu.response_known = ONE_BALANCE
        start_parts(ecu, damping, moment, lateral, momentum)
        # the body may be speeding up by all of it
        leave_room(ecu, BODY, size, 0)
        leave_room(ecu, JUMP, size, 0)
        leave_room(ecu, SIDE_FORCE, sat31(cal.response_min << STARTING), 0)
    calm: i32 = cal.response_min + rsh(cal.response_min, 1)
    if ecu.response_known == ONE_BALANCE and size < calm:
        ecu.response_known = BOTH
        ecu.balance_ticks[LATERAL] = 0
        ecu.balance_ticks[STEADY] = 0
        start_balance(ecu, LATERAL, acting, momentum)
        start_balance(ecu, STEADY, 0, 0)
    stretched: i32 = product(damping, cal.response_stretch, 30)
    bumpy: i32 = rough(ecu, cal)
    changed: i32 = at_once(ecu, DAMPERS, damping, ONE)
    leave_mean(ecu, DAMPERS, changed, RATTLING)
    if ecu.response_known == BOTH:
        shown: i32 = magnitude(sat31(ecu.balance_spring[LATERAL] + damping - moment))
        wrong: i32 = left_over(ecu, cal, LATERAL, acting, momentum)
        stretch(ecu, LATERAL, stretched)
        turning: i32 = product(ecu.speed, ecu.yaw_rate, 23)
        beside: i32 = product(turning - ecu.lateral_acceleration, cal.response_lateral, 20)
        watch_lateral_balance(ecu, cal, wrong, beside, sat31(shown + magnitude(damping)))
        by_force: i32 = at_once(ecu, STEADY, lateral, rsh(cal.response_wash, SLOWER))
        watch_model(ecu, cal, by_force, wrong)
        may_be: i32 = of_force(ecu, cal, by_force, wrong) + rsh(magnitude(moment), 2)
        watch_steady(ecu, cal, wrong, beside, sat31(may_be + bumpy))
    side_force: i32 = left_over(ecu, cal, SIDE_FORCE, lateral, 0)
    springs: i32 = left_over(ecu, cal, SPRINGS, 0, 0)
    dampers: i32 = left_over(ecu, cal, DAMPERS, damping, 0)
    actuators: i32 = left_over(ecu, cal, ACTUATORS, moment, 0)
    inertia: i32 = left_over(ecu, cal, BODY, 0, momentum)
    stretch(ecu, SPRINGS, stretched)
    left: i32 = sat31(inertia + springs + dampers - side_force - actuators)
    watch_left_over(ecu, cal, left, inertia, bumpy)
