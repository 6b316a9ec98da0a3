"""What a calibration must fulfil before it may run, and that it stays what it was.

Its CRC is that of Ethernet and ZIP (CRC-32, polynomial 0x04C11DB7 reflected) over the bytes of the
record before it, as memory has them; bytes between the fields are zero.
"""

from firmware.calibration import (
    BARS,
    BYPASS,
    COMPENSATOR,
    DAMPERS,
    N_POINTS,
    VALVES,
    Calibration,
)
from firmware.limits import (
    BYTES,
    FIELDS,
    HIGH,
    LAST_BYTE,
    LAST_WORD,
    LOW,
    RANGE,
    SIZE,
)
from firmware.state import (
    CORRUPT,
    INIT,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_ROLL_REFERENCE,
    RX_SUSPENSION_RATE,
    RX_VEHICLE_MOTION,
    SAFE,
    Ecu,
)
from firmware.subset import clamp, i32, octet, word

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
RULE_CRC = 511

# what four bits leave of a CRC-32
CRC32: tuple[i32, ...] = (
    0,
    498536548,
    997073096,
    651767980,
    1994146192,
    1802195444,
    1303535960,
    1342533948,
    -306674912,
    -267414716,
    -690576408,
    -882789492,
    -1687895376,
    -2032938284,
    -1609899400,
    -1111625188,
)


def watch_calibration(ecu: Ecu, cal: Calibration) -> None:
    """Check another word of the calibration; once the CRC of all is wrong, it is corrupt for good.

    A round takes as many calls as the calibration has words. The remainder is kept inverted, so
    that it starts at 0.
    """
    if ecu.calibration_word == CORRUPT:
        return
    at: i32 = clamp(ecu.calibration_word, 0, LAST_WORD - 1)
    rest: i32 = (ecu.calibration_crc ^ -1) ^ word(cal, at)
    for _ in range(8):
        rest = ((rest >> 4) & 0x0FFFFFFF) ^ CRC32[rest & 15]
    ecu.calibration_crc = rest ^ -1
    ecu.calibration_word = at + 1
    if at < LAST_WORD - 1:
        return
    ecu.calibration_word = 0
    if ecu.calibration_crc != cal.crc:
        ecu.calibration_word = CORRUPT
        if ecu.mode == INIT:
            ecu.mode = SAFE
    ecu.calibration_crc = 0


def check_ranges(cal: Calibration) -> i32:
    """Return 0, or the number of the first field that is out of its range, from 1."""
    at: i32 = 0
    for field in range(FIELDS):
        its: i32 = RANGE[field]
        size: i32 = SIZE[field]
        for _ in range(size):
            value: i32 = 0
            step: i32 = 4
            if its < BYTES:
                value = word(cal, clamp(at >> 2, 0, LAST_WORD))
            else:
                value = octet(cal, clamp(at, 0, LAST_BYTE))
                step = 1
            if value < LOW[its] or value > HIGH[its]:
                return field + 1
            at = clamp(at + step, 0, LAST_BYTE + 1)
    return 0


def check(cal: Calibration) -> i32:
    """Return 0, or what refuses the calibration: a field's number from 1, or a rule's.

    501 schedule speeds do not ascend; 502 the fade's ends are not in order; 503 the bounds of an
    identified ratio exclude one another; 504 valves need a compensator with two outputs; 505 two
    outputs need a compensator that drives bars or valves; 506 the Imu has no timeout; 507 bypass
    needs RollReference; 508 dampers need SuspensionRate; 509 dampers and valves need ActuatorState;
    510 the speed, which fades the command, needs VehicleMotion. ``init`` adds 511: a wrong CRC.
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
