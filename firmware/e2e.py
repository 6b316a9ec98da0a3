"""AUTOSAR E2E profile 1, variant 1A: CRC-8 SAE J1850 over both bytes of the data id and the frame.

The checksum is byte 0, the counter the low nibble of byte 1 and runs 0 to 14. The receiver's state
machine is E2E_P01Check of AUTOSAR's E2E protocol specification: a frame counts as valid when its
counter has moved by one, or by no more than the step accepted after frames were missed.
"""

from typing import Annotated

from firmware.calibration import Calibration
from firmware.state import Ecu
from firmware.subset import byte, clamp, i32, u8

COUNTERS = 15
NO_COUNTER = 15

# fmt: off
CRC_TABLE: tuple[u8, ...] = (
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


def checksum(payload: Annotated[list[u8], 8], data_id: i32) -> u8:
    """Return the checksum of a frame, whose byte 0 is left out, for its 16-bit data id."""
    crc: i32 = CRC_TABLE[byte(data_id)]
    crc = CRC_TABLE[crc ^ byte(data_id >> 8)]
    # written out: a loop would cost more than its body
    crc = CRC_TABLE[crc ^ payload[1]]
    crc = CRC_TABLE[crc ^ payload[2]]
    crc = CRC_TABLE[crc ^ payload[3]]
    crc = CRC_TABLE[crc ^ payload[4]]
    crc = CRC_TABLE[crc ^ payload[5]]
    crc = CRC_TABLE[crc ^ payload[6]]
    return CRC_TABLE[crc ^ payload[7]]


def protect(payload: Annotated[list[u8], 8], data_id: i32, counter: u8) -> None:
    """Write counter and checksum into a frame; the counter's byte keeps its high nibble."""
    payload[1] = byte((payload[1] & 240) | (counter & 15))
    payload[0] = checksum(payload, data_id)


def missed(ecu: Ecu, message: i32) -> None:
    """Note a check of ``message`` without new data: the accepted counter step grows."""
    ecu.e2e_delta[message] = clamp(ecu.e2e_delta[message] + 1, 0, 14)
    ecu.e2e_repeated[message] = clamp(ecu.e2e_repeated[message] + 1, 0, 14)


def accepted(ecu: Ecu, cal: Calibration, message: i32, counter: i32) -> i32:
    """Take ``counter`` as valid; return 1 where no resynchronisation is under way."""
    ecu.e2e_delta[message] = cal.e2e_max_delta[message]
    ecu.e2e_last[message] = clamp(counter, 0, 14)
    if ecu.e2e_repeated[message] <= cal.e2e_max_repeated[message]:
        ecu.e2e_repeated[message] = 0
        if ecu.e2e_resync[message] > 0:
            ecu.e2e_resync[message] = clamp(ecu.e2e_resync[message] - 1, 0, 14)
            return 0
        return 1
    ecu.e2e_repeated[message] = 0
    ecu.e2e_resync[message] = cal.e2e_sync[message]
    return 0


def check(
    ecu: Ecu, cal: Calibration, message: i32, payload: Annotated[list[u8], 8], data_id: i32
) -> i32:
    """Check a received frame; return 1 where its data may be used."""
    ecu.e2e_delta[message] = clamp(ecu.e2e_delta[message] + 1, 0, 14)
    counter: i32 = payload[1] & 15
    if counter >= COUNTERS or checksum(payload, data_id) != payload[0]:
        return 0
    if ecu.e2e_last[message] == NO_COUNTER:
        ecu.e2e_delta[message] = cal.e2e_max_delta[message]
        ecu.e2e_last[message] = clamp(counter, 0, 14)
        return 0
    step: i32 = counter - ecu.e2e_last[message]
    if step < 0:
        step += COUNTERS
    if step == 0:
        ecu.e2e_repeated[message] = clamp(ecu.e2e_repeated[message] + 1, 0, 14)
        return 0
    if step == 1 or step <= ecu.e2e_delta[message]:
        return accepted(ecu, cal, message, counter)
    ecu.e2e_repeated[message] = 0
    ecu.e2e_resync[message] = cal.e2e_sync[message]
    if ecu.e2e_resync[message] > 0:
        ecu.e2e_delta[message] = cal.e2e_max_delta[message]
        ecu.e2e_last[message] = clamp(counter, 0, 14)
    return 0
