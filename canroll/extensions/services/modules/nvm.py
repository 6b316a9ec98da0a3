"""Fault memory and learnt offsets over a loss of power, as one record that is checked.

``save`` before power goes, ``restore`` after ``init`` of the ECU. A board copies the record to its
non-volatile memory and back: ``size`` bytes.
"""

from canroll.extensions.services.modules.nvm_state import (
    ALL_CODES,
    ANOTHER_CALIBRATION,
    ANOTHER_VERSION,
    DAMAGED,
    VERSION,
    Nvm,
)
from canroll.extensions.services.modules.uds_state import N_KEPT
from canroll.firmware.calibration import Calibration
from canroll.firmware.check import folded
from canroll.firmware.state import N_FAULT_CODES, Ecu
from canroll.firmware.subset import byte, bytes_of, clamp, clear, i32, to_i32, u32


def size(nvm: Nvm) -> i32:
    """Return the bytes of the record."""
    return bytes_of(nvm)


def checksum(nvm: Nvm) -> i32:
    """Return the CRC-32 of all elements but the CRC, each as four bytes, the lowest first."""
    crc: u32 = 0
    for code in range(N_FAULT_CODES):
        crc = folded(crc, nvm.fault_count[code])
        crc = folded(crc, nvm.kept_mode[code])
        for k in range(N_KEPT):
            crc = folded(crc, nvm.kept[code][k])
    crc = folded(crc, nvm.known)
    crc = folded(crc, nvm.fault_latched)
    crc = folded(crc, nvm.offset_rate)
    crc = folded(crc, nvm.offset_acceleration)
    crc = folded(crc, nvm.version)
    crc = folded(crc, nvm.calibration)
    return to_i32(crc)


def refusal(nvm: Nvm, cal: Calibration) -> i32:
    """Return 0, or why the record is not taken: 1 another version, 2 damaged, 3 calibration."""
    if nvm.version != VERSION:
        return ANOTHER_VERSION
    if nvm.crc != checksum(nvm):
        return DAMAGED
    if nvm.calibration != cal.id:
        return ANOTHER_CALIBRATION
    return 0


def save(nvm: Nvm, ecu: Ecu, cal: Calibration) -> None:
    """Fill the record from a running ECU and seal it; it has no snapshots."""
    clear(nvm)
    for code in range(N_FAULT_CODES):
        nvm.fault_count[code] = ecu.fault_count[code]
    nvm.fault_latched = ecu.fault_latched
    nvm.offset_rate = ecu.offset_rate
    nvm.offset_acceleration = ecu.offset_acceleration
    nvm.version = VERSION
    nvm.calibration = cal.id
    nvm.crc = checksum(nvm)


def restore(nvm: Nvm, ecu: Ecu, cal: Calibration) -> i32:
    """Give an ECU that ``init`` has started what was saved; return 0, or why not.

    Why: 1 another version or none, 2 damaged, 3 of another calibration. The ECU then stays as
    ``init`` left it.
    """
    reason: i32 = refusal(nvm, cal)
    if reason != 0:
        return reason
    ecu.fault_latched = ecu.fault_latched | clamp(nvm.fault_latched, 0, ALL_CODES)
    for code in range(N_FAULT_CODES):
        ecu.fault_count[code] = byte(clamp(ecu.fault_count[code] + nvm.fault_count[code], 0, 255))
    if cal.offset_learning == 1:
        ecu.offset_rate = clamp(nvm.offset_rate, -cal.offset_rate_max, cal.offset_rate_max)
        ecu.offset_acceleration = clamp(
            nvm.offset_acceleration, -cal.offset_acceleration_max, cal.offset_acceleration_max
        )
    return 0
