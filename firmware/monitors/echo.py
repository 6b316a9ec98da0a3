"""The age of the commands that come back, for a bus that is slower than the loop is designed for.

The actuators echo the counter of the command they accepted. When an echo is new its command was
sent longer ago than it may be where both ways together are late: not where a command or an echo is
lost, as a newer one then comes back. Commands that never do are judged by
:mod:`canroll.firmware.plausibility`. It is reported and changes no mode: the loop still has its
margins, and what it does to the body is judged by the other monitors.
"""

from canroll.firmware.calibration import Calibration
from canroll.firmware.com import protection
from canroll.firmware.monitors.residual import ECHO, judge
from canroll.firmware.plausibility import FAULT_COMMAND_LATE
from canroll.firmware.state import N_SENT, Ecu
from canroll.firmware.subset import byte, clamp, i32, u8

# new echoes in a row that are late before that is reported: a single one may have stood still
# while the actuators or the way back were away
LATE_ECHOES = 3
# a command is sent again two ticks after the longest way there and back, one of which is the tick
# in which the echo is read
SPARE = 1


def note_sent(ecu: Ecu) -> None:
    """Remember when the command goes out that is being sent."""
    ecu.sent_last = byte((ecu.sent_last + 1) & (N_SENT - 1))
    ecu.sent_time[ecu.sent_last] = byte(ecu.time)


def note_echo(ecu: Ecu, cal: Calibration, slot: u8) -> None:
    """Judge a new echo by the age of its command; 256 ticks count as none."""
    behind: i32 = ecu.tx_counter[slot] - ecu.accepted_counter
    if behind < 0:
        behind += protection.TX_LAST_COUNTERS[slot] + 1
    if behind >= ecu.commands_sent:
        # of a command before init
        return
    behind = clamp(behind, 0, N_SENT - 1)
    sent: i32 = ecu.sent_time[(ecu.sent_last + N_SENT - behind) & (N_SENT - 1)]
    late: i32 = 0
    if ((byte(ecu.time) - sent) & 255) >= cal.acknowledge_ticks - SPARE:
        late = 1
    judge(ecu, ECHO, late, LATE_ECHOES)


def watch_echo(ecu: Ecu) -> None:
    """Report late echoes until one is in time."""
    if ecu.evidence[ECHO] == LATE_ECHOES:
        ecu.detected = ecu.detected | (1 << FAULT_COMMAND_LATE)
