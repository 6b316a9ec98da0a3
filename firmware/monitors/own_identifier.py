"""Frames of this ECU's own identifiers that somebody else sends: a second node, or an attacker.

A controller does not receive what it sends itself, so that any such frame is foreign, whatever it
carries. It is reported and changes no mode: the other sender is not silenced by SAFE, which takes
away the one right command among the wrong ones, and a single frame would end the control. Whether
the actuators follow the other sender is judged by what they deliver.
"""

from canroll.firmware.calibration import Calibration
from canroll.firmware.event_trigger import command_slot
from canroll.firmware.plausibility import FAULT_OWN_IDENTIFIER_HEARD
from canroll.firmware.state import AGE_MAX, TX_STATUS, Ecu
from canroll.firmware.subset import clamp, i32


def watch_own_identifiers(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Report frames of the slots in use for ``recovery_ticks`` after the last one."""
    if ecu.rx_own == 0 and ecu.foreign_ticks == 0:
        return
    ecu.foreign_ticks = clamp(ecu.foreign_ticks - elapsed, 0, AGE_MAX)
    if ecu.rx_own != 0:
        slot: i32 = ecu.rx_own - 1
        ecu.rx_own = 0
        if slot >= TX_STATUS or slot == command_slot(cal):
            ecu.foreign_ticks = cal.recovery_ticks
    if ecu.foreign_ticks > 0:
        ecu.detected = ecu.detected | (1 << FAULT_OWN_IDENTIFIER_HEARD)
