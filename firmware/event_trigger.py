"""Event trigger: a command goes out only when it has moved enough, or the heartbeat is due.

Viadero 2022: send when e' Omega e > epsilon**2 u' Omega u, with e the difference to the command
sent last; an absolute floor keeps sensor noise from firing it near zero. The actuators echo the
counter of the command they accepted: the last command counts as received until its echo is overdue,
then it is sent again. Over a network the echo may lag several commands behind; that is accepted as
long as it advances. In INIT nothing is sent: what the actuators hold from before a restart fades.
"""

from canroll.firmware.calibration import BARS, DAMPERS, N_RING, SUSPENSION, Calibration
from canroll.firmware.com import signals
from canroll.firmware.monitors.delivery import note_command
from canroll.firmware.monitors.echo import note_echo, note_sent
from canroll.firmware.state import (
    AGE_MAX,
    INIT,
    RX_ACTUATOR_STATE,
    TX_ANTI_ROLL_BAR,
    TX_DAMPER,
    TX_SUSPENSION_FORCE,
    TX_VALVE,
    Ecu,
)
from canroll.firmware.subset import I32_MAX, byte, clamp, i32, i64, rsh, u8

NOTHING = 0
TRIGGERED = 1
HEARTBEAT = 2
NO_ECHO = 255
# squares are taken of quarter newton metres
COARSE = 12


def command_slot(cal: Calibration) -> u8:
    """Return the transmit slot of the calibrated actuator's command."""
    if cal.actuator == SUSPENSION:
        return TX_SUSPENSION_FORCE
    if cal.actuator == BARS:
        return TX_ANTI_ROLL_BAR
    if cal.actuator == DAMPERS:
        return TX_DAMPER
    return TX_VALVE


def acknowledge(ecu: Ecu, cal: Calibration) -> None:
    """Take note of a new echo of the command that the actuators follow."""
    if ecu.waiting == 0 or ecu.fresh[RX_ACTUATOR_STATE] == 0 or ecu.command_held == 0:
        return
    # an echo that stands still is of long ago, even where the counter has come round to it
    if ecu.accepted_counter == ecu.echo:
        return
    ecu.echo = ecu.accepted_counter
    ecu.unacknowledged = 0
    note_echo(ecu, cal, command_slot(cal))
    if ecu.accepted_counter == ecu.tx_counter[command_slot(cal)]:
        ecu.waiting = 0


def moved(ecu: Ecu, cal: Calibration) -> i32:
    """Return 1 where the new outputs differ enough from those sent last."""
    error: i64 = 0
    size: i64 = 0
    for k in range(2):
        e: i32 = rsh(ecu.outputs[k] - ecu.sent[k], COARSE)
        r: i32 = rsh(ecu.sent[k], COARSE)
        error += e * e
        size += r * r
    floor: i32 = rsh(cal.trigger_floor, COARSE)
    threshold: i64 = cal.trigger_epsilon_squared * size + floor * floor * (1 << 20)
    if error * (1 << 20) > threshold:
        return 1
    return 0


def due(ecu: Ecu, cal: Calibration) -> u8:
    """Return why a command is due now, or NOTHING."""
    if ecu.mode == INIT:
        return NOTHING
    if cal.event_trigger == 0 or cal.actuator == DAMPERS or moved(ecu, cal) == 1:
        return TRIGGERED
    if ecu.waiting == 1 and ecu.since_sent >= cal.acknowledge_ticks:
        return TRIGGERED
    if ecu.since_sent >= cal.heartbeat_ticks:
        return HEARTBEAT
    return NOTHING


def trigger(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Decide whether this tick sends a command; record the one that is under way."""
    acknowledge(ecu, cal)
    ecu.since_sent = clamp(ecu.since_sent + elapsed, 0, AGE_MAX)
    if ecu.waiting == 1:
        ecu.unacknowledged = clamp(ecu.unacknowledged + elapsed, 0, AGE_MAX)
    ecu.triggered = due(ecu, cal)
    if ecu.triggered != NOTHING:
        ecu.since_sent = 0
        note_command(ecu, cal)
        note_sent(ecu)
        # without a counter that comes back there is no echo to wait for
        ecu.waiting = cal.e2e & signals.TX_ECHOED[command_slot(cal)]
        if ecu.commands_sent < I32_MAX:
            ecu.commands_sent += 1
        for k in range(2):
            ecu.sent[k] = ecu.outputs[k]
    under_way: i32 = ecu.ring[ecu.ring_head]
    if ecu.triggered != NOTHING:
        under_way = ecu.given
    # no more of the ring than the prediction reads
    read: i32 = clamp(cal.predict_steps, 1, N_RING)
    steps: i32 = clamp(elapsed, 1, read)
    for _ in range(steps):
        ecu.ring_head = byte((ecu.ring_head + 1) & (N_RING - 1))
        ecu.ring[ecu.ring_head] = under_way


def init_trigger(ecu: Ecu) -> None:
    """Start with nothing sent and nothing echoed."""
    ecu.echo = NO_ECHO
    ecu.since_sent = AGE_MAX
