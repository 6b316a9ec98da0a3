"""Checksums and counters of the frames; made by codegen.generated.protection, not to be edited.

Frames of roll_control.dbc.
``check`` judges a received frame, ``protect`` finishes one to be sent.
"""

from typing import Annotated

from firmware.calibration import Calibration
from firmware.com import e2e
from firmware.state import Ecu
from firmware.subset import byte, i32, u8

# data ids; of each frame sent the highest value of its counter, 0: none
RX_DATA_IDS: tuple[i32, ...] = (3232, 3248, 3264, 3280, 3288)
TX_DATA_IDS: tuple[i32, ...] = (3200, 3201, 3202, 3203, 3840, 3841)
TX_LAST_COUNTERS: tuple[u8, ...] = (14, 14, 14, 14, 14, 14)
# fmt: off
CRC8_1D: tuple[u8, ...] = (
    0, 29, 58, 39, 116, 105, 78, 83, 232, 245, 210, 207, 156, 129, 166, 187,
    205, 208, 247, 234, 185, 164, 131, 158, 37, 56, 31, 2, 81, 76, 107, 118,
    135, 154, 189, 160, 243, 238, 201, 212, 111, 114, 85, 72, 27, 6, 33, 60,
    74, 87, 112, 109, 62, 35, 4, 25, 162, 191, 152, 133, 214, 203, 236, 241,
    19, 14, 41, 52, 103, 122, 93, 64, 251, 230, 193, 220, 143, 146, 181, 168,
    222, 195, 228, 249, 170, 183, 144, 141, 54, 43, 12, 17, 66, 95, 120, 101,
    148, 137, 174, 179, 224, 253, 218, 199, 124, 97, 70, 91, 8, 21, 50, 47,
    89, 68, 99, 126, 45, 48, 23, 10, 177, 172, 139, 150, 197, 216, 255, 226,
    38, 59, 28, 1, 82, 79, 104, 117, 206, 211, 244, 233, 186, 167, 128, 157,
    235, 246, 209, 204, 159, 130, 165, 184, 3, 30, 57, 36, 119, 106, 77, 80,
    161, 188, 155, 134, 213, 200, 239, 242, 73, 84, 115, 110, 61, 32, 7, 26,
    108, 113, 86, 75, 24, 5, 34, 63, 132, 153, 190, 163, 240, 237, 202, 215,
    53, 40, 15, 18, 65, 92, 123, 102, 221, 192, 231, 250, 169, 180, 147, 142,
    248, 229, 194, 223, 140, 145, 182, 171, 16, 13, 42, 55, 100, 121, 94, 67,
    178, 175, 136, 149, 198, 219, 252, 225, 90, 71, 96, 125, 46, 51, 20, 9,
    127, 98, 69, 88, 11, 22, 49, 44, 151, 138, 173, 176, 227, 254, 217, 196,
)
# fmt: on


def checksum_0(payload: Annotated[list[u8], 8], identity: i32) -> i32:
    """Return the checksum of a frame: E2E profile 1."""
    crc: i32 = CRC8_1D[byte(identity)]
    # written out: a loop would cost more than its body
    crc = CRC8_1D[crc ^ byte(identity >> 8)]
    crc = CRC8_1D[crc ^ payload[1]]
    crc = CRC8_1D[crc ^ payload[2]]
    crc = CRC8_1D[crc ^ payload[3]]
    crc = CRC8_1D[crc ^ payload[4]]
    crc = CRC8_1D[crc ^ payload[5]]
    crc = CRC8_1D[crc ^ payload[6]]
    return CRC8_1D[crc ^ payload[7]]


def check_0(ecu: Ecu, cal: Calibration, message: i32, slot: i32, identity: i32) -> i32:
    """Return 1 where the data of a received frame may be used."""
    counter: i32 = ecu.rx_payload[slot][1] & 15
    if counter >= 15:
        return 0
    expected: i32 = checksum_0(ecu.rx_payload[slot], identity)
    if expected != ecu.rx_payload[slot][0]:
        return 0
    return e2e.resynchronised(ecu, cal, message, counter, 15)


def protect_0(payload: Annotated[list[u8], 8], counter: i32, identity: i32) -> None:
    """Write counter and checksum into a frame."""
    payload[1] = byte((payload[1] & 240) | (counter & 15))
    value: i32 = checksum_0(payload, identity)
    payload[0] = byte(value)


def check(ecu: Ecu, cal: Calibration, message: i32, slot: i32) -> i32:
    """Return 1 where the data of the frame in ``slot`` may be used."""
    return check_0(ecu, cal, message, slot, RX_DATA_IDS[message])


def protect(ecu: Ecu, slot: i32) -> None:
    """Write counter and checksum into the frame to be sent in ``slot``."""
    protect_0(ecu.tx_payload[slot], ecu.tx_counter[slot], TX_DATA_IDS[slot])
