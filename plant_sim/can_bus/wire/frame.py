"""Lengths of CAN frames to the bit, from the actual identifier and payload (ISO 11898-1:2015).

One convention everywhere: a frame occupies the bus from the first edge of its SOF to the end of
the three-bit interframe space; a receiver takes it at the end of the last-but-one EOF bit.
In FD frames with bit-rate switch the rate changes at the sample points of BRS and of the CRC
delimiter. Wherever these are, the two bits last together one bit of either rate: BRS counts as
nominal, the CRC delimiter as data, all bits between them as data and all others as nominal.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.kernels.jit import interpreted, njit

EXTENDED: Final = 1
REMOTE: Final = 2
FD: Final = 4
BIT_RATE_SWITCH: Final = 8
ERROR_STATE: Final = 16
"""An FD frame whose sender is error-passive: its ESI bit is recessive."""

ERROR_FLAG: Final = 32
"""No frame: an error flag that a node sends on the idle bus, and all others answer."""
RECESSIVE_INDICATOR: Final = 64
"""An FD frame with a recessive ESI bit requested by its sender, as for a forwarded frame."""

INTERFRAME_BITS: Final = 3
ERROR_DELIMITER_BITS: Final = 8
ERROR_FLAG_BITS: Final = 6
ERROR_FRAME_BITS: Final = 2 * ERROR_FLAG_BITS + ERROR_DELIMITER_BITS + INTERFRAME_BITS
"""On the idle bus: the flag, the answer of all others, delimiter and interframe space."""
REFUSAL_BITS: Final = ERROR_FLAG_BITS + ERROR_DELIMITER_BITS
"""By how much an error flag in the last bit of EOF, answered one bit later, prolongs a frame."""
SUSPEND_BITS: Final = 8
OVERLOAD_BITS: Final = 15
"""Overload frame: a flag of 6 bits, answered one bit later by all other nodes, and delimiter."""
TRAILER_BITS: Final = 10
"""CRC delimiter, ACK slot, ACK delimiter and 7 bits of EOF: never stuffed."""
RECEPTION_BITS_BEFORE_END: Final = 4
"""From the instant of reception to the end of the interframe space: last EOF bit, 3 bits."""

CRC15: Final = 0x4599
FD_LENGTHS: Final = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
_STUFF_MASK = 7


def _stuffing_table() -> NDArray[np.uint8]:
    """Next state and number of stuff bits after eight more bits: state = 4·last bit + run − 1."""
    table = np.zeros((8, 256), np.uint8)
    for state in range(8):
        for byte in range(256):
            last, run, stuffed = state >> 2, (state & 3) + 1, 0
            for position in range(7, -1, -1):
                bit = byte >> position & 1
                run = run + 1 if bit == last else 1
                last = bit
                if run == 5:
                    stuffed, last, run = stuffed + 1, 1 - bit, 1
            table[state, byte] = stuffed << 3 | last << 2 | run - 1
    return table


def _crc15_table() -> NDArray[np.int64]:
    table = np.zeros(256, np.int64)
    for byte in range(256):
        crc = byte << 7
        for _ in range(8):
            crc = (crc << 1) ^ (CRC15 if crc & 0x4000 else 0)
        table[byte] = crc & 0x7FFF
    return table


STUFFING: Final = _stuffing_table()
CRC15_TABLE: Final = _crc15_table()
_LENGTHS: Final = np.array(FD_LENGTHS, np.int64)


@njit
def length_code(length: int) -> int:
    """Return the DLC of ``length`` payload bytes (FD: the smallest code that holds them)."""
    code = 0
    while _LENGTHS[code] < length:
        code += 1
    return code


@njit
def arbitration_key(ident: int, flags: int) -> int:
    """Return the 32 bits of the arbitration field, as sent: the lower key wins.

    Base identifier, RTR or SRR, IDE, then extension and RTR: a standard frame wins against an
    extended one with equal base identifier, a data frame against its remote frame, and an error
    flag against every frame.
    """
    if flags & ERROR_FLAG:
        return -1
    remote = 1 if flags & REMOTE else 0
    if flags & EXTENDED:
        return (ident >> 18) << 21 | 3 << 19 | (ident & 0x3FFFF) << 1 | remote
    return ident << 21 | remote << 20


@njit
def frame_bits(ident: int, flags: int, length: int, payload: NDArray[np.uint8]) -> tuple[int, int]:
    """Return the bits at nominal and at data rate, SOF to the end of the interframe space.

    Args:
        ident: 11-bit identifier, or 29-bit with ``EXTENDED``.
        flags: any of ``EXTENDED``, ``REMOTE``, ``FD``, ``BIT_RATE_SWITCH``, ``ERROR_STATE``.
        length: payload bytes (of a remote frame: the requested length).
        payload: at least ``length`` bytes; not read for remote frames.
    """
    if flags & FD:
        return _fd_bits(ident, flags, length, payload)
    count = 0 if flags & REMOTE else length
    remote = 1 if flags & REMOTE else 0
    # the head is padded in front with bits that neither stuff nor run into SOF
    if flags & EXTENDED:
        head = (ident >> 18) << 27 | 3 << 25 | (ident & 0x3FFFF) << 7 | remote << 6 | length
        pad, head_bits = 1 << 39, 40
    else:
        head = ident << 7 | remote << 6 | length
        pad, head_bits = 0b10101 << 19, 24
    state, stuffed, crc = 4, 0, 0
    padded = head | pad
    for shift in range(head_bits - 8, -8, -8):
        step = STUFFING[state, padded >> shift & 0xFF]
        state = step & _STUFF_MASK
        stuffed += step >> 3
        crc = (crc << 8 & 0x7FFF) ^ CRC15_TABLE[(crc >> 7 ^ head >> shift) & 0xFF]
    for index in range(count):
        byte = payload[index]
        step = STUFFING[state, byte]
        state = step & _STUFF_MASK
        stuffed += step >> 3
        crc = (crc << 8 & 0x7FFF) ^ CRC15_TABLE[(crc >> 7 ^ byte) & 0xFF]
    # behind the last CRC bit its complement: no run goes on, so it adds no stuff bit
    tail = crc << 1 | (1 - (crc & 1))
    for shift in (8, 0):
        step = STUFFING[state, tail >> shift & 0xFF]
        state = step & _STUFF_MASK
        stuffed += step >> 3
    unstuffed = (39 if flags & EXTENDED else 19) + 8 * count + 15
    return unstuffed + stuffed + TRAILER_BITS + INTERFRAME_BITS, 0


@njit
def _fd_bits(ident: int, flags: int, length: int, payload: NDArray[np.uint8]) -> tuple[int, int]:
    code = length_code(length)
    count = _LENGTHS[code]
    switch = 1 if flags & BIT_RATE_SWITCH else 0
    # SOF … BRS: 17 or 36 bits at the nominal rate, then ESI and DLC
    if flags & EXTENDED:
        head = (ident >> 18) << 24 | 3 << 22 | (ident & 0x3FFFF) << 4 | 2 << 1 | switch
        padded, bits, nominal = 0b0101 << 36 | head, 40, 36
    else:
        head = ident << 5 | 2 << 1 | switch
        padded, bits, nominal = 0b1010101 << 17 | head, 24, 17
    state, stuffed = 4, 0
    for shift in range(bits - 8, -8, -8):
        step = STUFFING[state, padded >> shift & 0xFF]
        state = step & _STUFF_MASK
        stuffed += step >> 3
    nominal_stuffed = stuffed
    esi = 16 if flags & ERROR_STATE else 0
    last, run = state >> 2, (state & 3) + 1
    for position in range(4, -1, -1):
        bit = (esi | code) >> position & 1
        run = run + 1 if bit == last else 1
        last = bit
        # a fixed stuff bit follows the last bit before the stuff count in any case
        if run == 5 and (position > 0 or count > 0):
            stuffed += 1
            last, run = 1 - bit, 1
    state = last << 2 | (run - 1)
    for index in range(count):
        byte = payload[index] if index < length else 0
        step = STUFFING[state, byte]
        state = step & _STUFF_MASK
        stuffed += step >> 3
        # run 1 of the other value after a last bit: that stuff bit gave way to the fixed one
        if index == count - 1 and state >> 2 != byte & 1:
            stuffed -= 1
    crc_field = 4 + 17 + 6 if count <= 16 else 4 + 21 + 7
    data = 5 + 8 * count + crc_field + stuffed - nominal_stuffed
    nominal += nominal_stuffed + TRAILER_BITS + INTERFRAME_BITS
    if switch:
        return nominal - 1, data + 1
    return nominal + data, 0


@njit
def duration_ns(bits: int, bitrate: int) -> int:
    """Return the time of ``bits`` at ``bitrate`` bit/s, rounded to the nearest nanosecond."""
    return (bits * 1_000_000_000 + bitrate // 2) // bitrate


_duration_ns = interpreted(duration_ns)


def best_case_bits(length: int, flags: int = 0) -> tuple[int, int]:
    """Return a lower bound of ``frame_bits`` over identifiers and payloads: no stuff bit."""
    if flags & FD:
        count = FD_LENGTHS[length_code(length)]
        data = 5 + 8 * count + (27 if count <= 16 else 32)
        nominal = (36 if flags & EXTENDED else 17) + TRAILER_BITS + INTERFRAME_BITS
        return (nominal - 1, data + 1) if flags & BIT_RATE_SWITCH else (nominal + data, 0)
    count = 0 if flags & REMOTE else length
    return (67 if flags & EXTENDED else 47) + 8 * count, 0


def worst_case_bits(length: int, flags: int = 0) -> tuple[int, int]:
    """Return an upper bound of ``frame_bits`` over identifiers and payloads.

    Classic: g + 8s + 13 + ⌊(g + 8s − 1)/4⌋ with g = 34 or 54 (Davis et al. 2007, equation 1).
    FD: a stuff bit after every fourth bit from SOF to the last data bit, except for the last one
    (followed by a fixed stuff bit), with as many as possible in the part at nominal rate.
    """
    if flags & FD:
        nominal, data = best_case_bits(length, flags)
        head = 36 if flags & EXTENDED else 17
        stuffable = head + 5 + 8 * FD_LENGTHS[length_code(length)] - 1
        stuffed = (stuffable - 1) // 4
        if not flags & BIT_RATE_SWITCH:
            return nominal + stuffed, 0
        slow = (head - 1) // 4
        return nominal + slow, data + stuffed - slow
    bits, _ = best_case_bits(length, flags)
    count = 0 if flags & REMOTE else length
    return bits + ((54 if flags & EXTENDED else 34) + 8 * count - 1) // 4, 0


def worst_case_ns(length: int, flags: int = 0, *, bitrate: int, data_bitrate: int = 0) -> int:
    """Return an upper bound of a frame's time over identifiers and payloads, in nanoseconds.

    With bit-rate switch, stuff bits may be in either part, and the time of each part is rounded to
    whole nanoseconds: the result is the maximum over all divisions.
    """
    nominal, data = worst_case_bits(length, flags)
    movable = (35 if flags & EXTENDED else 16) // 4 if data else 0
    return max(
        transmission_ns((nominal - k, data + k), bitrate=bitrate, data_bitrate=data_bitrate)
        for k in range(movable + 1)
    )


def transmission_ns(bits: tuple[int, int], *, bitrate: int, data_bitrate: int | None = None) -> int:
    """Return the time of a frame of ``(nominal, data)`` bits in nanoseconds."""
    nominal, data = bits
    return _duration_ns(nominal, bitrate) + _duration_ns(data, data_bitrate or bitrate)


def length_of(ident: int, payload: bytes, flags: int = 0, **options: Any) -> tuple[int, int]:  # noqa: ANN401
    """Return ``frame_bits`` of a Python payload."""
    length = options.get("length", len(payload))
    buffer = np.zeros(64, np.uint8)
    buffer[: len(payload)] = np.frombuffer(payload, np.uint8)
    nominal, data = frame_bits(ident, flags, length, buffer)
    return int(nominal), int(data)
