"""Snapshots of fault codes over a loss of power, in the record of ``nvm``.

``save`` after that of ``nvm``; ``restore`` after those of ``nvm`` and ``init`` of the server.
"""

from canroll.extensions.services.modules.nvm import checksum, refusal
from canroll.extensions.services.modules.nvm_state import ALL_CODES, Nvm
from canroll.extensions.services.modules.uds_state import N_KEPT, Uds
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import N_FAULT_CODES, SAFE, Ecu
from canroll.firmware.subset import byte, clamp, i32


def save(nvm: Nvm, uds: Uds) -> None:
    """Add the snapshots to a record that was saved, and seal it anew."""
    nvm.known = uds.known
    for code in range(N_FAULT_CODES):
        nvm.kept_mode[code] = uds.kept_mode[code]
        for k in range(N_KEPT):
            nvm.kept[code][k] = uds.kept[code][k]
    nvm.crc = checksum(nvm)


def restore(nvm: Nvm, uds: Uds, ecu: Ecu, cal: Calibration) -> i32:
    """Give the server the snapshots that were saved; return 0, or why not, as of ``nvm``.

    The codes count as confirmed, but not as failed in this cycle, until they are active again.
    """
    reason: i32 = refusal(nvm, cal)
    if reason != 0:
        return reason
    saved: i32 = clamp(nvm.fault_latched & nvm.known, 0, ALL_CODES)
    fresh: i32 = saved & (saved ^ uds.known)
    uds.known = uds.known | saved
    uds.earlier = fresh & (fresh ^ ecu.fault_active)
    for code in range(N_FAULT_CODES):
        if (fresh & 1) != 0:
            uds.kept_mode[code] = byte(clamp(nvm.kept_mode[code], 0, SAFE))
            for k in range(N_KEPT):
                uds.kept[code][k] = nvm.kept[code][k]
        fresh = fresh >> 1
    return 0
