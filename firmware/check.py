"""Acceptance check of a calibration before it runs, and its cyclic CRC check afterwards.

The CRC is that of Ethernet and ZIP (CRC-32, polynomial 0x04C11DB7 reflected) over the elements
before it in the order of the record, of each word the lowest byte first. It is one of values: a
machine of either byte order finds the same.
"""

from canroll.firmware.calibration import (
    BARS,
    BYPASS,
    COMPENSATOR,
    DAMPERS,
    N_POINTS,
    VALVES,
    Calibration,
)
from canroll.firmware.limits import (
    BYTES,
    FIELDS,
    FIRST_WORD,
    HIGH,
    LAST_BYTE,
    LAST_WORD,
    LOW,
    RANGE,
    SIZE,
)
from canroll.firmware.state import (
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
from canroll.firmware.subset import clamp, i32, octet, to_i32, to_u32, u32, word

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
CRC32: tuple[u32, ...] = (
    0x00000000,
    0x1DB71064,
    0x3B6E20C8,
    0x26D930AC,
    0x76DC4190,
    0x6B6B51F4,
    0x4DB26158,
    0x5005713C,
    0xEDB88320,
    0xF00F9344,
    0xD6D6A3E8,
    0xCB61B38C,
    0x9B64C2B0,
    0x86D3D2D4,
    0xA00AE278,
    0xBDBDF21C,
)


def folded(crc: u32, value: i32) -> u32:
    """Return a CRC-32 continued by one word; both are kept inverted, so that it starts at 0."""
    rest: u32 = (crc ^ 0xFFFFFFFF) ^ to_u32(value)
    for _ in range(8):
        rest = (rest >> 4) ^ CRC32[rest & 15]
    return rest ^ 0xFFFFFFFF


def checked_word(cal: Calibration, at: i32) -> i32:
    """Return word ``at`` of what the CRC is over; four bytes make one, the lowest first."""
    if at >= FIRST_WORD:
        return word(cal, clamp(at, FIRST_WORD, LAST_WORD))
    first: i32 = 4 * clamp(at, 0, FIRST_WORD - 1)
    low: u32 = octet(cal, first) | octet(cal, first + 1) << 8
    high: u32 = octet(cal, first + 2) | octet(cal, first + 3) << 8
    return to_i32(low | high << 16)


def watch_calibration(ecu: Ecu, cal: Calibration) -> None:
    """Check the next word of the calibration; a wrong CRC marks it corrupt permanently.

    A round takes as many calls as the calibration has words.
    """
    if ecu.calibration_word == CORRUPT:
        return
    at: i32 = clamp(ecu.calibration_word, 0, LAST_WORD - 1)
    ecu.calibration_crc = to_i32(folded(to_u32(ecu.calibration_crc), checked_word(cal, at)))
    ecu.calibration_word = at + 1
    if at < LAST_WORD - 1:
        return
    ecu.calibration_word = 0
    if ecu.calibration_crc != cal.crc:
        ecu.calibration_word = CORRUPT
        if ecu.mode == INIT:
            ecu.mode = SAFE
    ecu.calibration_crc = 0


def fits(cal: Calibration, bounds: i32, at: i32) -> i32:
    """Return 1 where the element at byte ``at`` is within range number ``bounds``, else 0."""
    value: i32 = 0
    if bounds < BYTES:
        value = word(cal, clamp(at >> 2, 0, LAST_WORD))
    else:
        value = octet(cal, clamp(at, 0, LAST_BYTE))
    if value < LOW[bounds] or value > HIGH[bounds]:
        return 0
    return 1


def check_ranges(cal: Calibration) -> i32:
    """Return 0, or the number of the first field that is out of its range, from 1."""
    at: i32 = 0
    for field in range(FIELDS):
        bounds: i32 = RANGE[field]
        size: i32 = SIZE[field]
        for _ in range(size):
            if fits(cal, bounds, at) == 0:
                return field + 1
            step: i32 = 4
            if bounds >= BYTES:
                step = 1
            at = clamp(at + step, 0, LAST_BYTE + 1)
    return 0


def check(cal: Calibration) -> i32:
    """Return 0, or the reason for refusal: a field's number from 1, or a rule's.

    501 schedule speeds do not ascend; 502 the fade's ends are not in order; 503 the bounds of an
    identified ratio exclude one another; 504 valves need a compensator with two outputs; 505 two
    outputs need a compensator that drives bars or valves; 506 the Imu has no timeout; 507 bypass
    needs RollReference; 508 dampers need SuspensionRate; 509 dampers and valves need ActuatorState;
    510 the speed, which fades the command, needs VehicleMotion. ``init`` adds 511: a wrong CRC.
    """
    field: i32 = check_ranges(cal)
    if field != 0:
        return field
    return check_rules(cal)


def check_rules(cal: Calibration) -> i32:
    """Return 0, or the number of the first rule by which fields in their ranges do not agree."""
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
