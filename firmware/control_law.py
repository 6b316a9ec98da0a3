"""The control laws: state feedback with feedforward, static output feedback, LTI compensator.

u = -K x - K_ff a_y is the shared form of LQR, H-infinity and sliding mode (Yim 2020, (13), (19),
(40) with the sign that stabilises); u = K y is Redondo 2021, (5), and Viadero 2022. The compensator
is in observer form on the saturated output, so that it does not wind up.
"""

from typing import Annotated

from canroll.firmware import stage
from canroll.firmware.calibration import (
    BYPASS,
    COMPENSATOR,
    N_ORDER,
    ONE,
    OUTPUT_FEEDBACK,
    VALVES,
    Calibration,
)
from canroll.firmware.fixed_point import product, shifted, weighted
from canroll.firmware.monitors.rolling import YAW
from canroll.firmware.plausibility import BAD_ACCELERATION
from canroll.firmware.state import ACTIVE, DEGRADED, LATERAL, ROLL, ROLL_RATE, RX_IMU, Ecu
from canroll.firmware.subset import clamp, i32, i64, rsh, sat31


def rate_input(ecu: Ecu, cal: Calibration) -> i32:
    """Return the roll rate as measured, without its learnt offset (Q27)."""
    if cal.observer == BYPASS:
        return ecu.x[ROLL_RATE]
    return sat31(ecu.rate_good - ecu.offset_rate)


def lateral_input(ecu: Ecu, cal: Calibration) -> i32:
    """Return the lateral acceleration as measured, without its learnt offset (Q24)."""
    if cal.observer == BYPASS:
        return ecu.x[LATERAL]
    return sat31(ecu.acceleration_good - ecu.offset_acceleration)


def state_feedback(ecu: Ecu, cal: Calibration) -> i32:
    """Return u = -(feedback) x - (feedforward) x from the predicted estimate, Q14.

    Without a valid lateral acceleration the feedforward has ramped to zero.
    """
    fed_back: i64 = rsh(weighted(cal.feedback, ecu.ahead), cal.feedback_shift)
    fed_forward: i32 = shifted(weighted(cal.feedforward, ecu.ahead), cal.feedforward_shift)
    return sat31(-fed_back - rsh(fed_forward * ecu.feedforward, 30))


def output_feedback(ecu: Ecu, cal: Calibration) -> i32:
    """Return u = K [roll rate, lateral acceleration, roll angle], Q14."""
    acc: i64 = cal.output_gain[0] * rate_input(ecu, cal)
    acc += cal.output_gain[1] * lateral_input(ecu, cal)
    acc += cal.output_gain[2] * ecu.x[ROLL]
    return shifted(acc, cal.output_gain_shift)


def steering_input(ecu: Ecu, cal: Calibration) -> i32:
    """Return the lateral acceleration by steering, as far as tyres can follow it (Q24)."""
    return clamp(ecu.steering_acceleration, -cal.steering_limit, cal.steering_limit)


def driven(ecu: Ecu, cal: Calibration, row: Annotated[list[i32], 4], steered: i32) -> i64:
    """Return a row of the compensator times its inputs: roll, roll rate, a_y, a_y by steering.

    Except the roll angle, which no sensor measures, they are unfiltered: the compensator filters.
    """
    acc: i64 = row[0] * ecu.x[ROLL] + row[1] * rate_input(ecu, cal)
    return acc + row[2] * lateral_input(ecu, cal) + row[3] * steered


def carried(ecu: Ecu, cal: Calibration, row: Annotated[list[i32], N_ORDER]) -> i64:
    """Return a row of the compensator times its states."""
    acc: i64 = 0
    for j in range(cal.compensator_order):
        acc += row[j] * ecu.compensator_x[j]
    return acc


def advance_compensator(ecu: Ecu, cal: Calibration, steered: i32) -> None:
    """Advance the compensator's state with its inputs and the outputs after limiting."""
    for i in range(cal.compensator_order):
        acc: i64 = driven(ecu, cal, cal.compensator_b[i], steered)
        acc += carried(ecu, cal, cal.compensator_a[i])
        for k in range(2):
            acc += cal.compensator_e[i][k] * ecu.outputs[k]
        ecu.work[i] = shifted(acc, cal.compensator_shift[i])
    for i in range(cal.compensator_order):
        ecu.compensator_x[i] = ecu.work[i]


def curve(ecu: Ecu, cal: Calibration) -> i32:
    """Return the lateral acceleration (Q24) that two of three agree on, 0 where none do.

    The median of accelerometer, speed times yaw rate and steering: no one sensor can turn it round.
    """
    if cal.observer == BYPASS:
        return ecu.x[LATERAL]
    measured: i32 = ecu.lateral_acceleration
    if ecu.lateral_lost == 1 or ecu.bad_ticks[BAD_ACCELERATION] > 0:
        measured = 0
    turning: i32 = 0
    if (ecu.valid[RX_IMU] & YAW) != 0:
        turning = product(ecu.speed, ecu.yaw_rate, 23)
    steered: i32 = 0
    if ecu.motion_lost == 0:
        steered = ecu.steering_acceleration
    if turning < steered:
        return clamp(measured, turning, steered)
    return clamp(measured, steered, turning)


def fading(ecu: Ecu, cal: Calibration, output: i32) -> i32:
    """Return what is left of a held output: in a curve that is known, nothing outward."""
    left: i32 = product(ecu.held[output], ecu.released, 30)
    if cal.actuator == VALVES:
        return left
    acceleration: i32 = curve(ecu, cal)
    if (left > 0 and acceleration > 0) or (left < 0 and acceleration < 0):
        return 0
    return left


def limited(ecu: Ecu, cal: Calibration, wanted: i32, output: i32, steps: i32) -> i32:
    """Apply schedule, authority, moment limit and slew limit to a wanted output.

    Where the law is not fully on, what is held of before makes up the rest.
    """
    u: i32 = product(wanted, ecu.gain_factor, 28)
    if ecu.authority != ONE:
        u = sat31(rsh(u * ecu.authority, 30) + rest(ecu, cal, output))
    u = clamp(u, -cal.moment_max, cal.moment_max)
    last: i32 = ecu.outputs[output]
    step: i32 = sat31(steps * cal.slew_max)
    return sat31(clamp(u - last, -step, step) + last)


def rest(ecu: Ecu, cal: Calibration, output: i32) -> i32:
    """Return the share of a held output that the law leaves over."""
    return product(fading(ecu, cal, output), ONE - ecu.authority, 30)


def control(ecu: Ecu, cal: Calibration, steps: i32) -> None:
    """Compute the moment of this tick; in INIT and SAFE what is held only fades.

    The slew limit is that of ``steps`` ticks; a compensator takes one step, however many it was.
    """
    if ecu.mode != ACTIVE and ecu.mode != DEGRADED:
        for k in range(2):
            ecu.outputs[k] = fading(ecu, cal, k)
        ecu.moment = sat31(ecu.outputs[0] + ecu.outputs[1])
        for i in range(cal.compensator_order):
            ecu.compensator_x[i] = 0
        stage.rest(ecu, cal)
        return
    if cal.law == COMPENSATOR:
        steered: i32 = steering_input(ecu, cal)
        for k in range(cal.compensator_outputs):
            acc: i64 = driven(ecu, cal, cal.compensator_d[k], steered)
            acc += carried(ecu, cal, cal.compensator_c[k])
            wanted: i32 = shifted(acc, cal.compensator_output_shift[k])
            wanted = stage.moment(ecu, cal, wanted, k, steps)
            ecu.outputs[k] = limited(ecu, cal, wanted, k, steps)
        ecu.moment = sat31(ecu.outputs[0] + ecu.outputs[1])
        advance_compensator(ecu, cal, steered)
        return
    u: i32 = 0
    if cal.law == OUTPUT_FEEDBACK:
        u = output_feedback(ecu, cal)
    else:
        u = state_feedback(ecu, cal)
    u = stage.moment(ecu, cal, u, 0, steps)
    ecu.moment = limited(ecu, cal, u, 0, steps)
    ecu.outputs[0] = ecu.moment


def init_control(ecu: Ecu, cal: Calibration) -> None:
    """Start with no moment and the front share of standstill."""
    ecu.front_share = cal.schedule_front_share[0]
