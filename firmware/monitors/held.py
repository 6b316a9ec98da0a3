"""Signals that stand still to the last bit while others, of the same motion, move: one rule.

No motion and no noise keeps a sample the same. The lateral acceleration is compared with yaw rate
times speed, the roll rate with the mean of what both suspensions roll. That holds in any manoeuvre,
at the tyres' limit as well. A finding lasts until the next ``init``.
"""

from firmware.calibration import Calibration
from firmware.fixed_point import product
from firmware.monitors.persistence import lasting, magnitude
from firmware.monitors.residuals import GYRO, LATERAL, MOTION, STROKE, YAW
from firmware.state import Ecu
from firmware.subset import i32, sat31

# the signals
LATERAL_ACCELERATION = 0
ROLL_RATE = 1


def watch_signal(ecu: Ecu, cal: Calibration, k: i32, value: i32, witness: i32) -> i32:
    """Return 1 where signal ``k`` has stood still for its time while its witness moved."""
    stands: i32 = 0
    if value != ecu.held_value[k]:
        ecu.held_value[k] = value
        ecu.held_witness[k] = witness
    elif magnitude(sat31(witness - ecu.held_witness[k])) > cal.held_min[k]:
        stands = 1
    ecu.held_ticks[k] = lasting(ecu.held_ticks[k], stands, cal.held_ticks[k])
    if ecu.held_ticks[k] == cal.held_ticks[k]:
        return 1
    return 0


def watch_held(ecu: Ecu, cal: Calibration) -> None:
    """Judge the newest samples of lateral acceleration and roll rate, after the residuals."""
    trust: i32 = ecu.residual_trust
    if (trust & (LATERAL | YAW | MOTION)) == (LATERAL | YAW | MOTION):
        turning: i32 = ecu.residual_input[7]
        if watch_signal(ecu, cal, LATERAL_ACCELERATION, ecu.lateral_acceleration, turning) == 1:
            ecu.lateral_contradicted = 1
    if (trust & (GYRO | STROKE)) == (GYRO | STROKE):
        front: i32 = product(ecu.residual_input[0], cal.held_roll[0], 29)
        rear: i32 = product(ecu.residual_input[1], cal.held_roll[1], 29)
        if watch_signal(ecu, cal, ROLL_RATE, ecu.roll_rate, sat31(front + rear)) == 1:
            ecu.rate_contradicted = 1
