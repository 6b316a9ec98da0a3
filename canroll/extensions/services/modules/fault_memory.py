"""Fault codes as diagnostic trouble codes, with a status and a snapshot each.

Code i of the loop has the number 5Ai00h, as text C1Aii-00 (ii in hexadecimal): chassis,
manufacturer-specific, no failure type.
"""

from canroll.extensions.services.modules.isotp import put
from canroll.extensions.services.modules.uds_state import N_KEPT, Uds
from canroll.firmware.state import N_FAULT_CODES, Ecu
from canroll.firmware.subset import clamp, i32

FAMILY = 0x5A
# bits of the status that are kept: test failed, failed in this cycle, confirmed
FAILED = 0x01
FAILED_HERE = 0x02
CONFIRMED = 0x08
AVAILABLE = 0x0B
# one record, of the tick in which the code was latched
RECORD = 1
ALL = 0xFF

# data of a snapshot by identifier, as ReadDataByIdentifier has them; the mode is one byte
MODE = 0x0100
KEPT: tuple[i32, ...] = (0x0101, 0x0102, 0x0103, 0x0104)


def keep_snapshots(uds: Uds, ecu: Ecu) -> None:
    """Keep a snapshot for each fault code that was latched in this tick."""
    uds.earlier = uds.earlier & (uds.earlier ^ ecu.fault_active)
    latched: i32 = ecu.fault_latched
    if latched == uds.known:
        return
    fresh: i32 = latched & (latched ^ uds.known)
    uds.known = latched
    for code in range(N_FAULT_CODES):
        if (fresh & 1) != 0:
            uds.kept[code][0] = ecu.time
            uds.kept[code][1] = ecu.speed
            uds.kept[code][2] = ecu.roll_rate
            uds.kept[code][3] = ecu.lateral_acceleration
            uds.kept_mode[code] = ecu.mode
        fresh = fresh >> 1


def status(uds: Uds, ecu: Ecu, code: i32) -> i32:
    """Return the status of a fault code."""
    active: i32 = ecu.fault_active
    latched: i32 = ecu.fault_latched
    earlier: i32 = uds.earlier
    bits: i32 = 0
    for k in range(N_FAULT_CODES):
        if k == code:
            if (active & 1) != 0:
                bits = bits | FAILED
            if (latched & 1) != 0:
                bits = bits | CONFIRMED
                if (earlier & 1) == 0:
                    bits = bits | FAILED_HERE
        earlier = earlier >> 1
        active = active >> 1
        latched = latched >> 1
    return bits


def put_code(uds: Uds, ecu: Ecu, code: i32) -> None:
    """Append a fault code's number and status to the response."""
    put(uds, FAMILY)
    put(uds, code)
    put(uds, 0)
    put(uds, status(uds, ecu, code))


def count(uds: Uds, ecu: Ecu, mask: i32) -> i32:
    """Return the number of fault codes whose status has a bit of ``mask``."""
    number: i32 = 0
    for code in range(N_FAULT_CODES):
        if (status(uds, ecu, code) & mask) != 0:
            number += 1
    return number


def put_codes(uds: Uds, ecu: Ecu, mask: i32) -> None:
    """Append the fault codes whose status has a bit of ``mask``; all of them where it is 0."""
    for code in range(N_FAULT_CODES):
        if mask == 0 or (status(uds, ecu, code) & mask) != 0:
            put_code(uds, ecu, code)


def put_number(uds: Uds, value: i32) -> None:
    """Append 32 bits, the highest byte first."""
    put(uds, value >> 24 & 255)
    put(uds, value >> 16 & 255)
    put(uds, value >> 8 & 255)
    put(uds, value & 255)


def put_snapshot(uds: Uds, ecu: Ecu, code: i32) -> None:
    """Append number and status of a fault code and its snapshot, where it has one."""
    number: i32 = clamp(code, 0, N_FAULT_CODES - 1)
    put_code(uds, ecu, number)
    if (status(uds, ecu, number) & CONFIRMED) == 0:
        return
    put(uds, RECORD)
    put(uds, N_KEPT + 1)
    put(uds, MODE >> 8)
    put(uds, MODE & 255)
    put(uds, uds.kept_mode[number])
    for k in range(N_KEPT):
        put(uds, KEPT[k] >> 8)
        put(uds, KEPT[k] & 255)
        put_number(uds, uds.kept[number][k])


def forget(uds: Uds, ecu: Ecu) -> None:
    """Clear all fault codes; those still active are latched anew, with a snapshot of now."""
    ecu.fault_latched = ecu.fault_active
    for code in range(N_FAULT_CODES):
        ecu.fault_count[code] = 0
    uds.known = 0
    uds.earlier = 0
    keep_snapshots(uds, ecu)
