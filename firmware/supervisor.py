"""Modes and the authority of the law.

INIT waits for good inputs. ACTIVE runs the law. DEGRADED does without one input: the lateral
acceleration (one-sensor observer, no feedforward), speed and steering (the last ones are kept), the
delivered moment (the commanded one is used) or one corner or bar (its moment moves). SAFE holds the
last command, fades it and keeps the heartbeat. Both end when all inputs have been good for the
calibrated time, except after a corrupt calibration, which is permanent.

What the car leans on is not taken from it at once: the held command and the force of a failed
corner fade over ``release_ticks``, one period of the body's roll: the body goes to the roll of the
car without control, and a tenth of the way beyond at most. Taken away at once it would overshoot by
half. After a restart the law takes over what is being delivered.
"""

from canroll.firmware.calibration import DAMPERS, ONE, STATE_MAX, Calibration
from canroll.firmware.com import signals
from canroll.firmware.monitors.axles import watch_axles, watch_heave
from canroll.firmware.monitors.delivery import watch_delivery
from canroll.firmware.monitors.echo import watch_echo
from canroll.firmware.monitors.own_identifier import watch_own_identifiers
from canroll.firmware.monitors.redundancy import watch_redundancy
from canroll.firmware.monitors.response import watch_response
from canroll.firmware.monitors.rolling import watch_rolling
from canroll.firmware.monitors.samples import init_samples, watch_samples
from canroll.firmware.monitors.speed import watch_speed
from canroll.firmware.plausibility import (
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
from canroll.firmware.state import ACTIVE, AGE_MAX, CORRUPT, DEGRADED, INIT, SAFE, Ecu
from canroll.firmware.subset import clamp, i32, sat31, tdiv


def hold(ecu: Ecu, first: i32, second: i32) -> None:
    """Let outputs fade from here, without the law."""
    ecu.held[0] = first
    ecu.held[1] = second
    ecu.released = ONE
    ecu.authority = 0


def take_over(ecu: Ecu, cal: Calibration) -> None:
    """Begin with the moment that the actuators still deliver, as after a restart in a curve."""
    if ecu.moment_unknown == 1 or cal.actuator >= DAMPERS:
        return
    if cal.compensator_outputs == 2:
        hold(ecu, ecu.delivered[0], ecu.delivered[1])
    else:
        hold(ecu, ecu.delivered[0] + ecu.delivered[1], 0)
    for k in range(2):
        ecu.outputs[k] = clamp(ecu.held[k], -cal.moment_max, cal.moment_max)
        ecu.guarded[k] = ecu.outputs[k]


def fade(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Move authority and feedforward along the ramp, what is let go over a period of the roll."""
    up: i32 = sat31(elapsed * tdiv(ONE, cal.ramp_ticks))
    down: i32 = -sat31(elapsed * tdiv(ONE, cal.release_ticks))
    if ecu.mode == ACTIVE or ecu.mode == DEGRADED:
        ecu.authority = clamp(ecu.authority + up, 0, ONE)
    ecu.released = clamp(ecu.released + down, 0, ONE)
    for corner in range(4):
        change: i32 = up
        if ecu.failed[corner] == 1:
            change = down
        ecu.trust[corner] = clamp(ecu.trust[corner] + change, 0, ONE)
    if ecu.lateral_lost == 1:
        up = -up
    ecu.feedforward = clamp(ecu.feedforward + up, 0, ONE)


def change_mode(ecu: Ecu, cal: Calibration, severity: i32) -> None:
    """Move between the modes; the way back up takes good inputs for the calibrated time."""
    if severity == UNSAFE:
        ecu.good_ticks = 0
        if ecu.mode == ACTIVE or ecu.mode == DEGRADED:
            hold(ecu, ecu.outputs[0], ecu.outputs[1])
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
        if ecu.mode == INIT:
            take_over(ecu, cal)
        ecu.mode = ACTIVE
        if severity == DEGRADING:
            ecu.mode = DEGRADED
        ecu.good_ticks = 0


def supervise(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Judge all inputs, set the mode and move what fades."""
    ecu.detected = signals.contradicted(ecu) << FAULT_DISAGREEMENT
    ecu.detected = ecu.detected | (ecu.envelope_acted << FAULT_ENVELOPE)
    watch_own_identifiers(ecu, cal, elapsed)
    watch_echo(ecu)
    watch_samples(ecu, cal, elapsed)
    watch_speed(ecu, cal, elapsed)
    watch_redundancy(ecu, cal)
    watch_rolling(ecu, cal)
    motion: i32 = watch_motion(ecu, cal, elapsed)
    watch_delivery(ecu, cal)
    watch_response(ecu, cal, elapsed)
    watch_axles(ecu, cal)
    watch_heave(ecu, cal)
    actuators: i32 = watch_actuators(ecu, cal, elapsed)
    if elapsed > 1:
        ecu.detected = ecu.detected | (1 << FAULT_TICK_MISSED)
    if ecu.calibration_word == CORRUPT:
        ecu.detected = ecu.detected | (1 << FAULT_CALIBRATION_CRC)
        motion = UNSAFE
    latch_faults(ecu)
    ecu.good_ticks = clamp(ecu.good_ticks + elapsed, 0, AGE_MAX)
    severity: i32 = motion
    if actuators > severity:
        severity = actuators
    change_mode(ecu, cal, severity)
    fade(ecu, cal, elapsed)


def init_supervisor(ecu: Ecu) -> None:
    """Start in INIT, with nothing known of the vehicle's motion and moment."""
    ecu.mode = INIT
    ecu.motion_lost = 1
    ecu.moment_unknown = 1
    # no sample has this value
    ecu.frozen_lateral = STATE_MAX
    ecu.feedforward = ONE
    for corner in range(4):
        ecu.trust[corner] = ONE
    init_samples(ecu)
