"""Modes and the authority of the law.

INIT waits for good inputs. ACTIVE runs the law. DEGRADED does without one input: the lateral
acceleration (one-sensor observer, no feedforward), speed and steering (the last ones are kept), the
delivered moment (the commanded one is used) or one corner or bar (its moment moves). SAFE ramps the
command to zero and keeps the heartbeat. Both end when all inputs have been good for the calibrated
time, except after a corrupt calibration, which is permanent.
"""

from firmware.calibration import ONE, STATE_MAX, Calibration
from firmware.com import signals
from firmware.monitors.clock import init_clock, watch_clock
from firmware.monitors.delivery import watch_delivery
from firmware.monitors.echo import watch_echo
from firmware.monitors.erratic import watch_erratic
from firmware.monitors.held import watch_held
from firmware.monitors.mirror import watch_mirror
from firmware.monitors.own_identifier import watch_own_identifiers
from firmware.monitors.residuals import watch_residuals
from firmware.plausibility import (
    DEGRADING,
    FAULT_CALIBRATION_CRC,
    FAULT_DISAGREEMENT,
    FAULT_ENVELOPE,
    FAULT_TICK_MISSED,
    UNSAFE,
    latch_faults,
    watch_actuators,
    watch_motion,
)
from firmware.state import ACTIVE, AGE_MAX, CORRUPT, DEGRADED, INIT, SAFE, Ecu
from firmware.subset import clamp, i32, sat31, tdiv


def change_mode(ecu: Ecu, cal: Calibration, severity: i32) -> None:
    """Move between the modes; the way back up takes good inputs for the calibrated time."""
    if severity == UNSAFE:
        ecu.good_ticks = 0
        if ecu.mode == ACTIVE or ecu.mode == DEGRADED:
            for k in range(2):
                ecu.last_outputs[k] = ecu.outputs[k]
            # the ramp starts at what was given last, wherever the way up had come to
            ecu.authority = ONE
            ecu.mode = SAFE
        return
    if ecu.mode == ACTIVE:
        if severity == DEGRADING:
            ecu.mode = DEGRADED
            ecu.good_ticks = 0
        return
    if ecu.mode == DEGRADED:
        if severity == DEGRADING:
            ecu.good_ticks = 0
        elif ecu.good_ticks >= cal.recovery_ticks:
            ecu.mode = ACTIVE
        return
    needed: i32 = cal.init_ticks
    if ecu.mode == SAFE:
        needed = cal.recovery_ticks
    if ecu.good_ticks >= needed:
        ecu.mode = ACTIVE
        if severity == DEGRADING:
            ecu.mode = DEGRADED
        ecu.good_ticks = 0


def supervise(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Judge all inputs, set the mode and move the authority along its ramp."""
    ecu.found = signals.contradicted(ecu) << FAULT_DISAGREEMENT
    ecu.found = ecu.found | (ecu.envelope_acted << FAULT_ENVELOPE)
    watch_own_identifiers(ecu, cal, elapsed)
    watch_echo(ecu)
    watch_clock(ecu, cal, elapsed)
    watch_erratic(ecu, cal, elapsed)
    watch_mirror(ecu, cal)
    motion: i32 = watch_motion(ecu, cal, elapsed)
    watch_delivery(ecu, cal)
    watch_residuals(ecu, cal, elapsed)
    watch_held(ecu, cal)
    actuators: i32 = watch_actuators(ecu, cal, elapsed)
    if elapsed > 1:
        ecu.found = ecu.found | (1 << FAULT_TICK_MISSED)
    if ecu.calibration_word == CORRUPT:
        ecu.found = ecu.found | (1 << FAULT_CALIBRATION_CRC)
        motion = UNSAFE
    latch_faults(ecu)
    ecu.good_ticks = clamp(ecu.good_ticks + elapsed, 0, AGE_MAX)
    severity: i32 = motion
    if actuators > severity:
        severity = actuators
    change_mode(ecu, cal, severity)
    change: i32 = sat31(elapsed * tdiv(ONE, cal.ramp_ticks))
    rise: i32 = -change
    if ecu.mode == ACTIVE or ecu.mode == DEGRADED:
        rise = change
    ecu.authority = clamp(ecu.authority + rise, 0, ONE)
    if ecu.lateral_lost == 1:
        change = -change
    ecu.feedforward = clamp(ecu.feedforward + change, 0, ONE)


def init_supervisor(ecu: Ecu) -> None:
    """Start in INIT, with nothing known of the vehicle's motion and moment."""
    ecu.mode = INIT
    ecu.motion_lost = 1
    ecu.moment_unknown = 1
    # no sample has these values
    ecu.held_value[0] = STATE_MAX
    ecu.held_value[1] = STATE_MAX
    ecu.feedforward = ONE
    init_clock(ecu)
