"""Receivers of AUTOSAR's end-to-end protection: validation of a frame by its counter.

Checksums and their positions are specific to each frame (``protection``); this module is common to
all counters; ``message`` is the number of a received frame. A frame is valid when its counter has
advanced by one, or by no more than the step accepted after frames were missed.
"""

from canroll.firmware.calibration import Calibration
from canroll.firmware.com.frames import COUNTER_MAX
from canroll.firmware.com.signals import RX_MESSAGES
from canroll.firmware.state import Ecu
from canroll.firmware.subset import clamp, i32

NO_COUNTER = COUNTER_MAX
STEP_MAX = 15
REPEATED_MAX = 14


def due(ecu: Ecu, message: i32) -> None:
    """Note that a frame of ``message`` is due: the accepted counter step grows."""
    ecu.e2e_delta[message] = clamp(ecu.e2e_delta[message] + 1, 0, STEP_MAX)


def missed(ecu: Ecu, message: i32) -> None:
    """Note a check of ``message`` without new data."""
    ecu.e2e_repeated[message] = clamp(ecu.e2e_repeated[message] + 1, 0, REPEATED_MAX)


def accepted(ecu: Ecu, cal: Calibration, message: i32, counter: i32) -> i32:
    """Accept ``counter`` as valid; return 1 where no resynchronisation is under way."""
    ecu.e2e_delta[message] = cal.e2e_max_delta[RX_MESSAGES[message]]
    ecu.e2e_last[message] = counter & COUNTER_MAX
    if ecu.e2e_repeated[message] <= cal.e2e_max_repeated[RX_MESSAGES[message]]:
        ecu.e2e_repeated[message] = 0
        if ecu.e2e_resync[message] > 0:
            ecu.e2e_resync[message] = clamp(ecu.e2e_resync[message] - 1, 0, 14)
            return 0
        return 1
    ecu.e2e_repeated[message] = 0
    ecu.e2e_resync[message] = cal.e2e_sync[RX_MESSAGES[message]]
    return 0


def resynchronised(ecu: Ecu, cal: Calibration, message: i32, counter: i32, values: i32) -> i32:
    """Check the counter of a frame with a correct checksum; return 1 where its data may be used.

    E2E_P01Check and E2E_P02Check of AUTOSAR's E2E protocol specification.
    """
    if ecu.e2e_last[message] == NO_COUNTER:
        ecu.e2e_delta[message] = cal.e2e_max_delta[RX_MESSAGES[message]]
        ecu.e2e_last[message] = counter & COUNTER_MAX
        return 0
    step: i32 = counter - ecu.e2e_last[message]
    if step < 0:
        step += values
    if step == 0:
        missed(ecu, message)
        return 0
    if step == 1 or step <= ecu.e2e_delta[message]:
        return accepted(ecu, cal, message, counter)
    ecu.e2e_repeated[message] = 0
    ecu.e2e_resync[message] = cal.e2e_sync[RX_MESSAGES[message]]
    if ecu.e2e_resync[message] > 0:
        ecu.e2e_delta[message] = cal.e2e_max_delta[RX_MESSAGES[message]]
        ecu.e2e_last[message] = counter & COUNTER_MAX
    return 0


def in_sequence(ecu: Ecu, cal: Calibration, message: i32, counter: i32, values: i32) -> i32:
    """Check the counter of a frame with a correct checksum; return 1 where its data may be used.

    E2E_P05Check, and those of profiles 4, 6, 7, 11 and 22: every correct frame becomes the last
    one, there is no resynchronisation. They start as if the highest counter had been received.
    """
    step: i32 = counter - clamp(ecu.e2e_last[message], 0, values - 1)
    if step < 0:
        step += values
    ecu.e2e_last[message] = counter & COUNTER_MAX
    if step >= 1 and step <= cal.e2e_max_delta[RX_MESSAGES[message]]:
        return 1
    return 0
