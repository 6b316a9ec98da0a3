"""Plausibility, timeouts and fault codes of the inputs, and their effect on the mode.

An input is lost when no valid frame of it arrives in time, when it repeats one sample, or when its
value has been an error code or implausible for longer than its timeout.
"""

from canroll.firmware.calibration import (
    BARS,
    BYPASS,
    COMPENSATOR,
    DAMPERS,
    N_ORDER,
    OUTPUT_FEEDBACK,
    VALVES,
    Calibration,
)
from canroll.firmware.com import signals
from canroll.firmware.state import (
    AGE_MAX,
    FIRST_FRAME,
    INIT,
    N_FAULT_CODES,
    REST,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_ROLL_REFERENCE,
    RX_SUSPENSION_RATE,
    RX_VEHICLE_MOTION,
    Ecu,
)
from canroll.firmware.subset import byte, clamp, i32, sat31, u8

# fault codes; 0 to 4: no valid frame of message m in time
FAULT_DISAGREEMENT = 5
FAULT_ROLL_RATE = 6
FAULT_ACCELERATION = 7
FAULT_STUCK = 8
FAULT_REFERENCE = 9
FAULT_SPEED = 10
FAULT_STROKE = 11
FAULT_MOMENT = 12
FAULT_CORNER_STUCK = 13
FAULT_CORNER_FLOATING = 14
FAULT_COMMAND = 15
FAULT_TICK_MISSED = 16
FAULT_CALIBRATION = 17
FAULT_CALIBRATION_CRC = 18
FAULT_ROLL_RATE_CONTRADICTED = 19
FAULT_LATERAL_CONTRADICTED = 20
FAULT_MOTION_CONTRADICTED = 21
FAULT_ACTUATOR_CONTRADICTED = 22
FAULT_ENVELOPE = 23
FAULT_OWN_IDENTIFIER_HEARD = 24
FAULT_COMMAND_LATE = 25
FAULT_SAMPLE_RATE_OFF = 26
FAULT_SENSOR_ERRATIC = 27

ALL_FAULT_CODES = (1 << N_FAULT_CODES) - 1

# by message: the bits of the faults that it is late and that a signal of it lacks its value
LATE: tuple[i32, ...] = (1, 2, 4, 8, 16)
LACKS: tuple[i32, ...] = (64, 1024, 2048, 4096, 512)
# and the signals that are needed, as bits of ecu.valid
NEEDED: tuple[u8, ...] = (1, 3, 15, 3, 7)

# what a finding does to the mode
GOOD = 0
DEGRADING = 1
UNSAFE = 2

# corner states of ActuatorState; the last two, and no other, have bit 1
LIMITED = 1
STUCK = 2
FLOATING = 3

# inputs whose values are watched: indices of bad_ticks
BAD_ROLL_RATE = 0
BAD_ACCELERATION = 1
BAD_SPEED = 2
BAD_STROKE = 3
BAD_MOMENT = 4
BAD_REFERENCE = 5

OVERDUE = 8


def latch_faults(ecu: Ecu) -> None:
    """Make the faults found in this tick the active fault codes; latch and count new ones."""
    if ecu.detected == ecu.fault_active:
        return
    appeared: i32 = ecu.detected & (ALL_FAULT_CODES ^ ecu.fault_active)
    ecu.fault_active = ecu.detected
    ecu.fault_latched = ecu.fault_latched | appeared
    left: i32 = ecu.detected
    number: i32 = 0
    for k in range(N_FAULT_CODES):
        number += left & 1
        left = left >> 1
        if (appeared & 1) != 0:
            ecu.fault_count[k] = byte(clamp(ecu.fault_count[k] + 1, 0, 255))
        appeared = appeared >> 1
    ecu.fault_number = byte(clamp(number, 0, 15))


def silence(ecu: Ecu, cal: Calibration, message: i32, needed: i32) -> i32:
    """Return 1 where a signal among the bits ``needed`` is late, or repeats one sample.

    The first one may arrive at any time within the minimum duration of INIT. A late signal that is
    not needed has no value.
    """
    patience: i32 = cal.timeout_ticks[message]
    if patience == 0 or ecu.fresh[message] == (signals.RX_CARRIED[message] | FIRST_FRAME):
        return 0
    waiting: i32 = 0
    if (signals.awaited(ecu, message) & needed) != 0:
        waiting = 1
    late: i32 = 0
    outdated: i32 = signals.outdated(ecu, message, patience, cal.init_ticks)
    if (outdated & needed) != 0:
        late = 1
        ecu.detected = ecu.detected | LATE[message]
    else:
        ecu.valid[message] = byte(ecu.valid[message] & (255 ^ outdated))
    # a message that is slower than the limit is not stuck between two of its frames
    limit: i32 = clamp(cal.stuck_ticks, cal.timeout_ticks[message], AGE_MAX)
    if (signals.RX_SIGNALS[message] & needed) != 0:
        if ecu.unchanged[message] > limit and (late | waiting) == 0:
            ecu.detected = ecu.detected | (1 << FAULT_STUCK)
            late = 1
    return late | waiting


def lasting(ecu: Ecu, watched: i32, timeout: i32, bad: i32, elapsed: i32) -> i32:
    """Count how long an input has been ``bad``; return 1 beyond its timeout, if it has one."""
    if bad == 0 or timeout == 0:
        ecu.bad_ticks[watched] = 0
        return 0
    ecu.bad_ticks[watched] = clamp(ecu.bad_ticks[watched] + elapsed, 0, AGE_MAX)
    if ecu.bad_ticks[watched] > timeout:
        return 1
    return 0


def lacking(ecu: Ecu, message: i32, needed: u8) -> i32:
    """Return 1 where a signal among the bits ``needed`` carries an error code or is contradicted.

    What was not yet received is not lacking: :func:`silence` judges that.
    """
    if (ecu.valid[message] & needed) == needed:
        return 0
    known: i32 = ecu.valid[message] | signals.awaited(ecu, message)
    if (known & needed) == needed:
        return 0
    return 1


def lost(ecu: Ecu, cal: Calibration, message: i32, elapsed: i32) -> i32:
    """Judge a message that is useless without one of its signals; return 1 where lost."""
    timeout: i32 = cal.timeout_ticks[message]
    if timeout == 0:
        return 0
    needed: u8 = (NEEDED[message] | REST) & signals.RX_CARRIED[message]
    late: i32 = silence(ecu, cal, message, needed)
    bad: i32 = lacking(ecu, message, needed)
    if lasting(ecu, message + 1, timeout, bad, elapsed) == 1:
        ecu.detected = ecu.detected | LACKS[message]
        return 1
    return late


def beyond(value: i32, limit: i32) -> i32:
    """Return 1 where the magnitude of ``value`` exceeds ``limit``."""
    if value > limit or value < -limit:
        return 1
    return 0


def law_reads(cal: Calibration, measured: i32) -> i32:
    """Return 1 where the law reads roll rate (0) or lateral acceleration (1) as measured."""
    if cal.law == OUTPUT_FEEDBACK and cal.output_gain[measured] != 0:
        return 1
    if cal.law == COMPENSATOR:
        for i in range(N_ORDER):
            if cal.compensator_b[i][measured + 1] != 0:
                return 1
        for k in range(2):
            if cal.compensator_d[k][measured + 1] != 0:
                return 1
    return 0


def roll_rate_needed(cal: Calibration) -> i32:
    """Return 1 where observer, identification or law cannot run without the roll rate."""
    if (cal.measurements & 1) != 0 or cal.identification == 1:
        return 1
    return law_reads(cal, 0)


def watch_lateral(ecu: Ecu, cal: Calibration, elapsed: i32) -> i32:
    """Judge the lateral acceleration; return its effect on the mode.

    A sample is bad too that differs from the last good one by more than a car's motion does in the
    time since, up to the timeout: what was lost by a jump is good once it is back near that one.
    The observer uses it again from the first good sample, the feedforward only after
    ``recovery_ticks`` of them.
    """
    bad: i32 = lacking(ecu, RX_IMU, 2) | beyond(ecu.lateral_acceleration, cal.acceleration_max)
    if ecu.mode == INIT:
        ecu.acceleration_ticks = AGE_MAX
    elif ecu.lateral_lost == 0:
        ecu.acceleration_ticks = clamp(ecu.acceleration_ticks + elapsed, 0, AGE_MAX)
    most: i32 = sat31(cal.acceleration_noise + ecu.acceleration_ticks * cal.acceleration_change)
    bad = bad | beyond(sat31(ecu.lateral_acceleration - ecu.acceleration_good), most)
    if bad == 0 and (ecu.fresh[RX_IMU] & 2) != 0:
        ecu.acceleration_good = ecu.lateral_acceleration
        ecu.acceleration_ticks = 0
    contradicted: i32 = (ecu.contradicted >> 1) & 1
    ecu.detected = ecu.detected | (contradicted << FAULT_LATERAL_CONTRADICTED)
    bad = bad | contradicted
    bad = lasting(ecu, BAD_ACCELERATION, cal.timeout_ticks[RX_IMU], bad, elapsed) | contradicted
    ecu.detected = ecu.detected | (bad << FAULT_ACCELERATION)
    ecu.lateral_good = clamp(ecu.lateral_good + elapsed, 0, AGE_MAX)
    if ecu.bad_ticks[BAD_ACCELERATION] > 0:
        ecu.lateral_good = 0
        bad = bad | ecu.lateral_lost
    if bad == 1:
        ecu.lateral_lost = 1
    elif ecu.lateral_good >= cal.recovery_ticks:
        ecu.lateral_lost = 0
    if bad == 0:
        return GOOD
    if law_reads(cal, 1) == 1:
        return UNSAFE
    if (cal.measurements & 2) == 0 and cal.identification == 0:
        return GOOD
    if (cal.measurements & 1) == 0:
        return UNSAFE
    return DEGRADING


def watch_imu(ecu: Ecu, cal: Calibration, elapsed: i32) -> i32:
    """Judge the inertial measurement; return its effect on the mode."""
    needed: i32 = roll_rate_needed(cal)
    # the roll rate, or without it the lateral acceleration
    late: i32 = silence(ecu, cal, RX_IMU, 2 - needed)
    bad: i32 = lacking(ecu, RX_IMU, 1) | beyond(ecu.roll_rate, cal.roll_rate_max)
    if bad == 0:
        ecu.rate_good = ecu.roll_rate
    bad = bad & needed
    bad = lasting(ecu, BAD_ROLL_RATE, cal.timeout_ticks[RX_IMU], bad, elapsed)
    ecu.detected = ecu.detected | (bad << FAULT_ROLL_RATE)
    rate: i32 = ecu.contradicted & 1
    motion: i32 = (ecu.contradicted >> 2) & 1
    ecu.detected = ecu.detected | (rate << FAULT_ROLL_RATE_CONTRADICTED)
    ecu.detected = ecu.detected | (motion << FAULT_MOTION_CONTRADICTED)
    bad = bad | rate | motion
    severity: i32 = watch_lateral(ecu, cal, elapsed)
    if cal.observer == BYPASS:
        return GOOD
    if (late | bad) != 0:
        return UNSAFE
    return severity


def watch_motion(ecu: Ecu, cal: Calibration, elapsed: i32) -> i32:
    """Judge the inputs of the vehicle's motion; return their effect on the mode."""
    severity: i32 = watch_imu(ecu, cal, elapsed)
    reference_lost: i32 = lost(ecu, cal, RX_ROLL_REFERENCE, elapsed)
    if cal.observer == BYPASS and reference_lost == 1:
        severity = UNSAFE
    motion: i32 = lost(ecu, cal, RX_VEHICLE_MOTION, elapsed)
    ecu.motion_lost = byte(motion | ecu.speed_fell)
    if ecu.motion_lost == 1 and severity == GOOD:
        severity = DEGRADING
    return severity


def watch_corners(ecu: Ecu, cal: Calibration) -> i32:
    """Judge the status of the four corners; return its effect on the mode.

    One failed corner degrades, as does one failed bar, which spans both corners of its axle. Where
    the delivered moment contradicts the commands both corners of the axle have failed.
    """
    failures: i32 = 0
    axles: i32 = ecu.contradicted >> 3
    if axles != 0:
        ecu.detected = ecu.detected | (1 << FAULT_ACTUATOR_CONTRADICTED)
    status: i32 = ecu.status[0] | ecu.status[1] | ecu.status[2] | ecu.status[3]
    if status < STUCK and axles == 0:
        for corner in range(4):
            ecu.failed[corner] = 0
        return GOOD
    for corner in range(4):
        status = ecu.status[corner]
        failed: i32 = status >> 1
        ecu.detected = ecu.detected | ((failed & (status ^ FLOATING)) << FAULT_CORNER_STUCK)
        ecu.detected = ecu.detected | ((failed & (status ^ STUCK)) << FAULT_CORNER_FLOATING)
        failed = failed | (axles & 1)
        ecu.failed[corner] = byte(failed)
        failures += failed
        if corner == 1:
            axles = axles >> 1
    if cal.actuator == BARS or cal.actuator == VALVES:
        return (ecu.failed[0] | ecu.failed[1]) + (ecu.failed[2] | ecu.failed[3])
    return clamp(failures, GOOD, UNSAFE)


def watch_actuators(ecu: Ecu, cal: Calibration, elapsed: i32) -> i32:
    """Judge the status of the actuators; return its effect on the mode."""
    ecu.moment_unknown = byte(lost(ecu, cal, RX_ACTUATOR_STATE, elapsed))
    severity: i32 = watch_corners(ecu, cal)
    if cal.timeout_ticks[RX_ACTUATOR_STATE] == 0:
        ecu.moment_unknown = 1
    elif ecu.moment_unknown == 1:
        if cal.actuator >= DAMPERS:
            severity = UNSAFE
        elif severity == GOOD:
            severity = DEGRADING
    if ecu.waiting == 1 and ecu.unacknowledged > OVERDUE * cal.acknowledge_ticks:
        ecu.detected = ecu.detected | (1 << FAULT_COMMAND)
    stroke_lost: i32 = lost(ecu, cal, RX_SUSPENSION_RATE, elapsed)
    if cal.actuator == DAMPERS and stroke_lost == 1:
        severity = UNSAFE
    return severity
