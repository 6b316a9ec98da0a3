"""Reported moments against the body's response, for actuators that report what they do not do.

The body rolls about its axis by what acts on it: springs and dampers, whose stroke rates are
measured, the lateral acceleration and the delivered moments. What is left of that balance is the
difference between true and reported moments, whatever the road does, for it acts through the
springs. All of it is washed out, so that no offset counts, and low-passed, so that the roll
acceleration is got from the roll rate without a derivative. What the model may be wrong by is a
share of each part of the balance, washed out and low-passed as what is left over: a mass that is
unknown excuses no more than its lateral force makes then. Where more is left to one side for a
while, no axle is believed: the sum does not tell which. At the tyres' limit, where wheels lift and
stops are reached, shares of what the body's inertia takes and of the moments may be left over
besides. The shares follow from what is stated not to be known (``canroll.gain_gen.monitors``).

A wrong lateral acceleration is left over likewise, and differs from yaw rate times speed to the
same side, which no lie about moments does. As no bank enters the balance, both may be small and the
washout slow; but it is as quick as the other until little acts: what the body's inertia took of it
at the start is forgotten by then. What the model may be wrong by is a share of what springs,
dampers and moments say of the lateral acceleration, and one of the moments. The finding lasts.

Where yaw rate times speed does not differ from it, what is left of the slow balance is what was
reported wrongly of the moments: one that ran away stays in it, which the quicker washout forgets
once the car goes straighter. Springs take up what a moment does that is not reported, and excuse
nothing here: what the model may be wrong by is a share of the lateral force, washed out as slowly,
and of the moments. A model that was seen to be better than it might be stays so: mass, height and
springs do not change while the car drives. A rough road adds up in what is integrated.
"""

from canroll.firmware.calibration import Q_SHARE, STATE_MAX, Calibration
from canroll.firmware.fixed_point import magnitude, product, shifted
from canroll.firmware.monitors.residual import (
    ACTUATORS,
    BODY,
    CALM,
    DAMPER_STEPS,
    DAMPERS,
    LATERAL,
    MODEL,
    SIDE_FORCE,
    SPRINGS,
    STEADY,
    balance,
    change,
    deflect,
    high_pass,
    judge,
    judge_axles,
    mean_step,
    peak_hold,
    share,
    side_of,
    start_balance,
)
from canroll.firmware.monitors.rolling import ROLL_SIGNAL, YAW, measured, within
from canroll.firmware.plausibility import NEEDED
from canroll.firmware.state import RX_ACTUATOR_STATE, RX_IMU, Ecu
from canroll.firmware.subset import clamp, i32, i64, rsh, sat31

# values of ecu.response_known: neither balance is judged, that of the moments, both
UNKNOWN = 0
ONE_BALANCE = 1
BOTH = 2
# bit of ecu.valid of an Imu frame
LATERAL_SIGNAL = 2
# what the model may be wrong by fades in 8 time constants of the low-pass
FADING = 3


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


def share_by_side(own: i32, other: i32, value: i32, mismatch: i32) -> i32:
    """Return a share of ``value``: its ``own`` where the ``mismatch`` is of the same side."""
    if side_of(mismatch, value, 0) != 0:
        return share(value, own)
    return share(value, other)


def lateral_uncertainty(
    ecu: Ecu, cal: Calibration, apparent: i32, moment: i32, mismatch: i32
) -> i32:
    """Return what the model may be wrong by in what is ``apparent`` of the lateral acceleration."""
    uncertainty: i32 = share_by_side(cal.lateral_share[0], cal.lateral_share[1], apparent, mismatch)
    uncertainty = sat31(uncertainty + share(moment, cal.lateral_share[2]))
    if within(ecu, cal.response_limit) == 0:
        uncertainty = sat31(uncertainty + share(apparent, cal.limit_share[1]))
    return uncertainty


def watch_lateral_balance(
    ecu: Ecu, cal: Calibration, mismatch: i32, by_yaw_rate: i32, uncertainty: i32
) -> None:
    """Judge the lateral acceleration by the balance's ``mismatch`` and by yaw rate times speed.

    ``by_yaw_rate`` is by how much that differs from it, ``uncertainty`` that of the model.
    """
    bound: i32 = peak_hold(ecu.bound[LATERAL], uncertainty, rsh(cal.response_pass, FADING))
    ecu.bound[LATERAL] = bound
    side: i32 = 0
    if ecu.motion_lost == 0 and (ecu.valid[RX_IMU] & YAW) != 0:
        side = side_of(mismatch, by_yaw_rate, sat31(bound + cal.steady_min))
    judge(ecu, LATERAL, side & 1, cal.response_ticks)


def watch_model(ecu: Ecu, cal: Calibration, by_force: i32, mismatch: i32) -> None:
    """Note for good that a lateral force leaves over no more for long than to the other side."""
    if ecu.evidence[MODEL] == cal.response_ticks:
        return
    right: i32 = 0
    if magnitude(mismatch) + cal.steady_min < share(by_force, cal.steady_share[1]):
        right = 1
    judge(ecu, MODEL, right, cal.response_ticks)


def force_uncertainty(ecu: Ecu, cal: Calibration, by_force: i32, mismatch: i32) -> i32:
    """Return what the model may be wrong by for so much lateral force, to the ``mismatch``'s side.

    Mass and height that are larger than designed for and softer springs leave over more to its own
    side than the reverse does to the other; until that was seen not to be so.
    """
    own: i32 = cal.steady_share[0]
    if ecu.evidence[MODEL] == cal.response_ticks:
        own = cal.steady_share[1]
    return share_by_side(own, cal.steady_share[1], by_force, mismatch)


def watch_steady(
    ecu: Ecu, cal: Calibration, mismatch: i32, by_yaw_rate: i32, uncertainty: i32
) -> None:
    """Judge the reported moments by the slow balance's ``mismatch``.

    ``by_yaw_rate`` as above: to the same side, it is the acceleration that may be wrong.
    ``uncertainty`` is that of the model.
    """
    bound: i32 = peak_hold(ecu.bound[STEADY], uncertainty, rsh(cal.response_pass, FADING))
    ecu.bound[STEADY] = bound
    late: i32 = product(ecu.bound[DAMPERS], cal.response_late[1], 10)
    bound = sat31(bound + late + cal.steady_min)
    if within(ecu, cal.response_limit) == 0 or side_of(mismatch, by_yaw_rate, cal.steady_min) != 0:
        bound = STATE_MAX
    judge_axles(ecu, STEADY, mismatch, bound, cal.response_ticks)


def start_parts(ecu: Ecu, damping: i32, moment: i32, lateral: i32, momentum: i32) -> None:
    """Start the balance of the moments from what acts, part by part."""
    start_balance(ecu, SIDE_FORCE, lateral)
    start_balance(ecu, SPRINGS, 0)
    start_balance(ecu, DAMPERS, damping)
    start_balance(ecu, ACTUATORS, moment)
    start_balance(ecu, BODY, 0)
    ecu.passed[BODY] = momentum
    start_balance(ecu, LATERAL, sat31(damping - moment - lateral))
    start_balance(ecu, STEADY, 0)
    ecu.past[DAMPER_STEPS] = damping


def road_uncertainty(ecu: Ecu, cal: Calibration) -> i32:
    """Return what dampers may make of unequal strokes, and of ones beyond their knee.

    Where the body only rolls or heaves both sides move alike, and rebound makes up for bump.
    """
    made: i64 = 0
    for axle in range(2):
        one: i32 = magnitude(ecu.stroke_rate[2 * axle])
        other: i32 = magnitude(ecu.stroke_rate[2 * axle + 1])
        made += magnitude(one - other) * cal.response_rough[axle]
        one = clamp(one - cal.response_knee, 0, STATE_MAX)
        other = clamp(other - cal.response_knee, 0, STATE_MAX)
        made += (one + other) * cal.response_fast[axle]
    return shifted(made, 23)


def watch_calm(ecu: Ecu, cal: Calibration, mismatch: i32) -> None:
    """Judge the slow balances once the start's ``mismatch`` and the model's may be little."""
    calm: i32 = 0
    if ecu.bound[BODY] + magnitude(mismatch) < rsh(cal.steady_min, 1):
        calm = 1
    if judge(ecu, CALM, calm, cal.response_ticks) == 1:
        ecu.response_known = BOTH
        ecu.evidence[LATERAL] = 0
        ecu.evidence[STEADY] = 0


def watch_body(ecu: Ecu, cal: Calibration, mismatch: i32, inertia: i32, bumpy: i32) -> None:
    """Judge the reported moments by the ``mismatch`` of the quick balance.

    ``inertia`` is what the body's takes, ``bumpy`` what dampers may make of a rough road.
    """
    actuators: i32 = ecu.passed[ACTUATORS]
    shares: i64 = cal.response_share[0] * magnitude(ecu.passed[SIDE_FORCE])
    shares += cal.response_share[1] * magnitude(ecu.passed[SPRINGS])
    shares += cal.response_share[2] * magnitude(ecu.passed[DAMPERS])
    shares += cal.response_share[3] * magnitude(actuators)
    shares += cal.response_share[4] * magnitude(inertia)
    if within(ecu, cal.response_limit) == 0:
        # stops take up what actuators give up, and no spring shows it
        shares += cal.limit_share[0] * magnitude(inertia)
        shares += cal.limit_share[1] * magnitude(actuators)
    uncertainty: i32 = sat31(shifted(shares, Q_SHARE) + bumpy)
    ecu.bound[BODY] = peak_hold(ecu.bound[BODY], uncertainty, rsh(cal.response_pass, FADING))
    # what the start leaves over
    ecu.bound[SPRINGS] = peak_hold(ecu.bound[SPRINGS], 0, cal.response_wash[0])
    late: i32 = product(ecu.bound[DAMPERS], cal.response_late[0], 10)
    bound: i32 = sat31(ecu.bound[BODY] + ecu.bound[SPRINGS] + late + cal.response_min)
    judge_axles(ecu, BODY, mismatch, bound, cal.response_ticks)


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
    if ecu.response_known == UNKNOWN:
        ecu.response_known = ONE_BALANCE
        start_parts(ecu, damping, moment, lateral, momentum)
        ecu.evidence[CALM] = 0
        # springs that bear a curve, or a body that is speeding up by as much
        ecu.bound[SPRINGS] = product(cal.response_limit, cal.response_lateral, 20)
    stretched: i32 = product(damping, cal.response_stretch, 30)
    bumpy: i32 = road_uncertainty(ecu, cal)
    mean_step(ecu, cal, DAMPERS, DAMPER_STEPS, damping)
    quick: i32 = cal.response_wash[0]
    slow: i32 = quick
    if ecu.response_known == BOTH:
        slow = cal.response_wash[1]
    inertia: i32 = change(ecu, BODY, momentum, cal.response_pass)
    lateral_mismatch: i32 = sat31(balance(ecu, cal, LATERAL, acting, slow) + inertia)
    deflect(ecu, LATERAL, stretched)
    by_force: i32 = high_pass(ecu, STEADY, lateral, slow)
    if ecu.response_known == BOTH:
        turning: i32 = product(ecu.speed, ecu.yaw_rate, 23)
        by_yaw_rate: i32 = product(turning - ecu.lateral_acceleration, cal.response_lateral, 20)
        apparent: i32 = sat31(lateral_mismatch + by_force)
        excused: i32 = lateral_uncertainty(ecu, cal, apparent, moment, lateral_mismatch)
        watch_lateral_balance(ecu, cal, lateral_mismatch, by_yaw_rate, excused)
        watch_model(ecu, cal, by_force, lateral_mismatch)
        may_be: i32 = force_uncertainty(ecu, cal, by_force, lateral_mismatch) + share(
            moment, cal.steady_share[2]
        )
        watch_steady(ecu, cal, lateral_mismatch, by_yaw_rate, sat31(may_be + bumpy))
    side_force: i32 = balance(ecu, cal, SIDE_FORCE, lateral, quick)
    springs: i32 = balance(ecu, cal, SPRINGS, 0, quick)
    dampers: i32 = balance(ecu, cal, DAMPERS, damping, quick)
    actuators: i32 = balance(ecu, cal, ACTUATORS, moment, quick)
    deflect(ecu, SPRINGS, stretched)
    mismatch: i32 = sat31(inertia + springs + dampers - side_force - actuators)
    watch_body(ecu, cal, mismatch, inertia, bumpy)
    if ecu.response_known == ONE_BALANCE:
        watch_calm(ecu, cal, mismatch)
