"""Kalman disturbance observer of roll, roll rate, effective lateral acceleration, gyro bias.

Every tick predicts with the delivered moment; every fresh measurement corrects, one scalar at a
time (the third state and why two measurements are needed: Yim 2020, section III, where roll rate
alone leaves [roll, a_y] unobservable). ``look_ahead`` then carries the estimate from the sample to
the instant at which the command will act, through the ring of commands that are under way.
"""

from typing import Annotated

from canroll.firmware.calibration import (
    BYPASS,
    DAMPERS,
    N_RING,
    N_STATES,
    PROPAGATED_COVARIANCE,
    Calibration,
)
from canroll.firmware.covariance import init_covariance, propagate, update
from canroll.firmware.fixed_point import product, shifted, weighted
from canroll.firmware.plausibility import BAD_ACCELERATION, BAD_ROLL_RATE, beyond
from canroll.firmware.state import (
    GYRO_BIAS,
    LATERAL,
    ROLL,
    ROLL_RATE,
    RX_IMU,
    RX_ROLL_REFERENCE,
    Ecu,
)
from canroll.firmware.subset import clamp, i32, i64, rsh, sat31, scaled, u8

MEASURED_ROLL_RATE = 0
MEASURED_ACCELERATION = 1
N_IDENTIFIED = 2


def advance(
    ecu: Ecu, cal: Calibration, z: Annotated[list[i32], N_STATES], moment: i32, steering: i32
) -> None:
    """Advance the state ``z`` by one tick under a moment (Q14) and an a_y by steering (Q24)."""
    roll: i32 = z[0]
    rate: i32 = z[1]
    lateral: i32 = z[2]
    jerk: i32 = z[3]
    bias: i32 = z[4]
    for i in range(N_STATES):
        acc: i64 = cal.gamma_steering[i] * steering + cal.phi[i][3] * jerk + cal.phi[i][4] * bias
        if i < N_IDENTIFIED:
            acc += ecu.model[i][0] * roll + ecu.model[i][1] * rate + ecu.model[i][2] * lateral
            acc += ecu.model[i][3] * moment
        else:
            acc += cal.phi[i][0] * roll + cal.phi[i][1] * rate + cal.phi[i][2] * lateral
            acc += cal.gamma[i] * moment
        z[i] = scaled(acc, cal.phi_shift[i])


def acting_moment(ecu: Ecu, cal: Calibration) -> i32:
    """Return the moment that acts: the delivered one, or the commanded where that is unknown.

    Commands to dampers and valves are not moments, and using them as such would feed back on
    itself: where the moment is unknown, it counts as zero.
    """
    if ecu.moment_unknown == 1:
        if cal.actuator >= DAMPERS:
            return 0
        return ecu.ring[ecu.ring_head]
    return sat31(ecu.delivered[0] + ecu.delivered[1])


def lateral_by_steering(ecu: Ecu) -> i32:
    """Return the lateral acceleration that the model relaxes to, Q24.

    An outdated steering angle would bias it: the estimate itself is returned, without effect.
    """
    if ecu.motion_lost == 1:
        return ecu.x[LATERAL]
    return ecu.steering_acceleration


def add_gains(
    ecu: Ecu,
    gains: Annotated[list[i32], N_STATES],
    shifts: Annotated[list[u8], N_STATES],
    innovation: i32,
) -> None:
    """Correct each state by its gain times the innovation."""
    for i in range(N_STATES):
        ecu.x[i] = sat31(ecu.x[i] + scaled(gains[i] * innovation, shifts[i]))


def correct(ecu: Ecu, cal: Calibration, measured: i32, y: i32, moment: i32) -> None:
    """Correct the estimate by one scalar measurement ``y``, in that measurement's format."""
    predicted: i64 = weighted(cal.output[measured], ecu.x) + cal.output_moment[measured] * moment
    innovation: i32 = y - shifted(predicted, cal.output_shift[measured])
    if cal.observer == PROPAGATED_COVARIANCE:
        update(ecu, cal, measured, innovation)
    elif (
        measured == MEASURED_ROLL_RATE
        and ecu.lateral_lost == 1
        and ecu.bad_ticks[BAD_ACCELERATION] > 0
    ):
        add_gains(ecu, cal.correction_single, cal.correction_single_shift, innovation)
    else:
        add_gains(ecu, cal.correction[measured], cal.correction_shift[measured], innovation)


def make_up(ecu: Ecu, missed: i32) -> None:
    """Go on from ``ahead`` through the estimate as the last tick did, for each tick missed.

    A model step for each missed tick would make a late tick later still; this costs only a sum.
    """
    for i in range(N_STATES):
        change: i32 = ecu.x[i] - ecu.ahead[i]
        ecu.x[i] = sat31(ecu.x[i] + missed * change)


def observe(ecu: Ecu, cal: Calibration, steps: i32) -> None:
    """Predict over ``steps`` ticks, then correct by what is fresh and good."""
    if cal.observer == BYPASS:
        if ecu.fresh[RX_ROLL_REFERENCE] != 0:
            ecu.x[ROLL] = ecu.reference_roll
            ecu.x[ROLL_RATE] = ecu.reference_rate
            ecu.x[LATERAL] = ecu.reference_acceleration
        return
    moment: i32 = acting_moment(ecu, cal)
    if steps > 1:
        for i in range(N_STATES):
            ecu.ahead[i] = ecu.x[i]
    advance(ecu, cal, ecu.x, moment, lateral_by_steering(ecu))
    if steps > 1:
        make_up(ecu, steps - 1)
    if cal.observer == PROPAGATED_COVARIANCE:
        propagate(ecu, cal, steps)
    measured: i32 = cal.measurements & ecu.fresh[RX_IMU]
    if (measured & 1) != 0 and ecu.bad_ticks[BAD_ROLL_RATE] == 0:
        rate: i32 = sat31(ecu.roll_rate - ecu.offset_rate)
        correct(ecu, cal, MEASURED_ROLL_RATE, rate, moment)
    if (measured & 2) != 0 and ecu.bad_ticks[BAD_ACCELERATION] == 0:
        lateral: i32 = sat31(ecu.lateral_acceleration - ecu.offset_acceleration)
        correct(ecu, cal, MEASURED_ACCELERATION, lateral, moment)
    ecu.x[GYRO_BIAS] = clamp(ecu.x[GYRO_BIAS], -cal.bias_max, cal.bias_max)


def look_ahead(ecu: Ecu, cal: Calibration) -> None:
    """Predict from the sample to the actuation, through the commands that are under way.

    Within a tick the moment is the mean of its values at both ends. That of dampers and valves does
    not follow their commands: it is held.
    """
    moment: i32 = acting_moment(ecu, cal)
    rate: i32 = cal.actuator_rate
    if cal.actuator >= DAMPERS:
        rate = 0
    steering: i32 = lateral_by_steering(ecu)
    for i in range(N_STATES):
        ecu.ahead[i] = ecu.x[i]
    for step in range(cal.predict_steps):
        command: i32 = ecu.ring[(ecu.ring_head + N_RING + 1 - cal.predict_steps + step) & 31]
        reached: i32 = sat31(moment + product(rate, command - moment, 30))
        mean: i32 = rsh(moment + reached, 1)
        advance(ecu, cal, ecu.ahead, mean, steering)
        moment = reached


def learn_offsets(ecu: Ecu, cal: Calibration) -> None:
    """Adapt the sensor offsets to the readings at standstill or straight ahead.

    At standstill only the gyro learns: the lateral acceleration there is the ground's slope.
    """
    if cal.offset_learning == 0 or ecu.fresh[RX_IMU] == 0 or ecu.motion_lost == 1:
        return
    if ecu.bad_ticks[BAD_ROLL_RATE] > 0 or ecu.bad_ticks[BAD_ACCELERATION] > 0:
        return
    turning: i32 = beyond(ecu.steering, cal.straight_steering) | beyond(
        ecu.yaw_rate, cal.straight_yaw_rate
    )
    if ecu.speed > 0 and (turning == 1 or ecu.speed < cal.fade_high):
        return
    rate: i32 = product(ecu.roll_rate - ecu.offset_rate, cal.offset_gain, cal.offset_shift)
    if (ecu.fresh[RX_IMU] & 1) == 0:
        rate = 0
    ecu.offset_rate = clamp(ecu.offset_rate + rate, -cal.offset_rate_max, cal.offset_rate_max)
    if ecu.speed == 0 or (ecu.fresh[RX_IMU] & 2) == 0:
        return
    error: i32 = ecu.lateral_acceleration - ecu.offset_acceleration
    lateral: i32 = product(error, cal.offset_gain, cal.offset_shift)
    ecu.offset_acceleration = clamp(
        ecu.offset_acceleration + lateral,
        -cal.offset_acceleration_max,
        cal.offset_acceleration_max,
    )


def init_observer(ecu: Ecu, cal: Calibration) -> None:
    """Start at rest, with the calibrated model."""
    for i in range(N_IDENTIFIED):
        for j in range(3):
            ecu.model[i][j] = cal.phi[i][j]
        ecu.model[i][3] = cal.gamma[i]
    init_covariance(ecu, cal)
