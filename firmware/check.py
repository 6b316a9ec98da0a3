"""What a calibration must fulfil before it may run."""

from firmware.calibration import (
    BARS,
    BYPASS,
    COMPENSATOR,
    DAMPERS,
    N_POINTS,
    VALVES,
    Calibration,
)
from firmware.limits import check_ranges
from firmware.state import (
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_ROLL_REFERENCE,
    RX_SUSPENSION_RATE,
    RX_VEHICLE_MOTION,
)
from firmware.subset import clamp, i32

RULE_SCHEDULE = 501
RULE_FADE = 502
RULE_RATIOS = 503
RULE_VALVES = 504
RULE_OUTPUTS = 505
RULE_IMU = 506
RULE_REFERENCE = 507
RULE_STROKE = 508
RULE_DELIVERED = 509
RULE_MOTION = 510


def check(cal: Calibration) -> i32:
    """Return 0, or what refuses the calibration: a field's number from 1, or a rule's.

    501 schedule speeds do not ascend; 502 the fade's ends are not in order; 503 the bounds of an
    identified ratio exclude one another; 504 valves need a compensator with two outputs; 505 two
    outputs need a compensator that drives bars or valves; 506 the Imu has no timeout; 507 bypass
    needs RollReference; 508 dampers need SuspensionRate; 509 dampers and valves need ActuatorState;
    510 the speed, which fades the command, needs VehicleMotion.
    """
    field: i32 = check_ranges(cal)
    if field != 0:
        return field
    points: i32 = clamp(cal.schedule_points, 1, N_POINTS)
    for k in range(1, points):
        if cal.schedule_speed[k] <= cal.schedule_speed[k - 1]:
            return RULE_SCHEDULE
    if cal.fade_high <= cal.fade_low:
        return RULE_FADE
    for k in range(2):
        if cal.rls_lo[k] > cal.rls_hi[k]:
            return RULE_RATIOS
    if cal.actuator == VALVES and cal.compensator_outputs != 2:
        return RULE_VALVES
    if cal.compensator_outputs == 2:
        if cal.law != COMPENSATOR or (cal.actuator != BARS and cal.actuator != VALVES):
            return RULE_OUTPUTS
    if cal.observer == BYPASS:
        if cal.timeout_ticks[RX_ROLL_REFERENCE] == 0:
            return RULE_REFERENCE
    elif cal.timeout_ticks[RX_IMU] == 0:
        return RULE_IMU
    if cal.actuator == DAMPERS and cal.timeout_ticks[RX_SUSPENSION_RATE] == 0:
        return RULE_STROKE
    if cal.actuator >= DAMPERS and cal.timeout_ticks[RX_ACTUATOR_STATE] == 0:
        return RULE_DELIVERED
    if cal.timeout_ticks[RX_VEHICLE_MOTION] == 0:
        return RULE_MOTION
    return 0
