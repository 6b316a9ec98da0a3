"""The record that outlives a loss of power: what a board writes to non-volatile memory.

It is copied to and from that memory as it is. Version and CRC say whether it may be taken back.
"""

from typing import Annotated

from canroll.extensions.services.modules.uds_state import N_KEPT
from canroll.firmware.state import N_FAULT_CODES
from canroll.firmware.subset import I32_MAX, I32_MIN, F, i32, record, u8

# of the record's layout; another number of fault codes is another layout
VERSION = 1 << 8 | N_FAULT_CODES
ALL_CODES = (1 << N_FAULT_CODES) - 1

# why a record is not taken back
ANOTHER_VERSION = 1
DAMAGED = 2
ANOTHER_CALIBRATION = 3


@record
class Nvm:
    """Faults and learnt offsets; the caller owns it, ``save`` fills it.

    Any value may come from memory, so the ranges are those of the types.
    """

    # fault memory
    fault_count: Annotated[list[u8], N_FAULT_CODES, F(0, 255, 0, "", "occurrences")]
    kept_mode: Annotated[list[u8], N_FAULT_CODES, F(0, 255, 0, "", "snapshots: mode of the loop")]
    kept: Annotated[
        list[list[i32]],
        N_FAULT_CODES,
        N_KEPT,
        F(I32_MIN, I32_MAX, 0, "", "snapshots: time, speed, roll rate, lateral acceleration"),
    ]
    known: Annotated[i32, F(I32_MIN, I32_MAX, 0, "", "bit i: code i has a snapshot")]
    fault_latched: Annotated[i32, F(I32_MIN, I32_MAX, 0, "", "bit i: code i has occurred")]

    # offsets
    offset_rate: Annotated[i32, F(I32_MIN, I32_MAX, 27, "rad/s", "learnt, roll rate")]
    offset_acceleration: Annotated[
        i32, F(I32_MIN, I32_MAX, 24, "m/s2", "learnt, lateral acceleration")
    ]

    # seal
    version: Annotated[i32, F(I32_MIN, I32_MAX, 0, "", "of this record")]
    calibration: Annotated[i32, F(I32_MIN, I32_MAX, 0, "", "id of that which it was saved with")]
    crc: Annotated[i32, F(I32_MIN, I32_MAX, 0, "", "CRC-32 of all other elements")]
