"""Frames of the ECU: the command where one is triggered, status and diagnostics in turn."""

from canroll.firmware.calibration import Calibration
from canroll.firmware.com import protection, signals
from canroll.firmware.com.frames import COUNTER_MAX
from canroll.firmware.event_trigger import NOTHING, command_slot
from canroll.firmware.state import (
    AGE_MAX,
    N_TX,
    TX_DIAGNOSTICS,
    TX_STATUS,
    Ecu,
)
from canroll.firmware.subset import byte, clamp, i32


def queue(ecu: Ecu, cal: Calibration, slot: i32) -> None:
    """Protect the frame in ``slot`` and mark it for sending."""
    if cal.e2e == 1:
        counter: i32 = ecu.tx_counter[slot] + 1
        if counter > protection.TX_LAST_COUNTERS[slot]:
            counter = 0
        ecu.tx_counter[slot] = counter & COUNTER_MAX
        protection.protect(ecu, slot)
    ecu.tx_pending[slot] = 1


def transmit(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Fill and queue the frames that are due."""
    if ecu.triggered != NOTHING:
        signals.pack(ecu, command_slot(cal))
        queue(ecu, cal, command_slot(cal))
    ecu.since_status = clamp(ecu.since_status + elapsed, 0, AGE_MAX)
    if ecu.since_status >= cal.status_ticks:
        ecu.since_status = 0
        signals.pack(ecu, TX_STATUS)
        queue(ecu, cal, TX_STATUS)
        signals.pack(ecu, TX_DIAGNOSTICS)
        queue(ecu, cal, TX_DIAGNOSTICS)
        page: i32 = ecu.diagnostics_page + 1
        if page >= signals.PAGES:
            page = 0
        ecu.diagnostics_page = byte(page)


def init_transmit(ecu: Ecu) -> None:
    """Make the first counters 0."""
    for slot in range(N_TX):
        ecu.tx_counter[slot] = protection.TX_LAST_COUNTERS[slot]
