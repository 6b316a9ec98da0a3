"""The bits of a frame on the wire (ISO 11898-1:2015)."""

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.can_bus.wire.frame import (
    BIT_RATE_SWITCH,
    CRC15,
    ERROR_STATE,
    EXTENDED,
    FD,
    FD_LENGTHS,
    REMOTE,
    length_code,
)
from canroll.plant_sim.kernels.jit import njit

_LENGTHS = np.array(FD_LENGTHS, np.int64)
_CRC17 = 0x1685B
_CRC21 = 0x102899


@njit
def _put(out: NDArray[np.uint8], at: int, value: int, width: int) -> int:
    for shift in range(width - 1, -1, -1):
        out[at] = value >> shift & 1
        at += 1
    return at


@njit
def _crc(bits: NDArray[np.uint8], count: int, crc: int, polynomial: int, width: int) -> int:
    mask = (1 << width) - 1
    for index in range(count):
        invert = (crc >> (width - 1) ^ bits[index]) & 1
        crc = crc << 1 & mask
        if invert:
            crc ^= polynomial & mask
    return crc


@njit
def wire_bits(
    ident: int,
    flags: int,
    length: int,
    payload: NDArray[np.uint8],
    out: NDArray[np.uint8],
) -> tuple[int, int, int]:
    """Write the bits of a frame, SOF to EOF, into ``out`` (at least 800 long): 0 is dominant.

    Returns:
        Number of bits, and the first bit and the bit after the last that count as sent at the
        data rate (equal where the frame has none). The ACK slot is written dominant, as
        acknowledged.
    """
    fd = flags & FD
    plain = np.empty(640, np.uint8)
    at = _put(plain, 0, 0, 1)
    remote = 1 if flags & REMOTE else 0
    if flags & EXTENDED:
        at = _put(plain, at, ident >> 18, 11)
        at = _put(plain, at, 3, 2)
        at = _put(plain, at, ident & 0x3FFFF, 18)
        at = _put(plain, at, remote, 1)
        at = _put(plain, at, 2 if fd else 0, 2)
    else:
        at = _put(plain, at, ident, 11)
        at = _put(plain, at, remote, 1)
        at = _put(plain, at, 0, 1)
        at = _put(plain, at, 2 if fd else 0, 2 if fd else 1)
    switch_at = 10_000
    if fd:
        at = _put(plain, at, 1 if flags & BIT_RATE_SWITCH else 0, 1)
        switch_at = at if flags & BIT_RATE_SWITCH else switch_at
        at = _put(plain, at, 1 if flags & ERROR_STATE else 0, 1)
    code = length_code(length)
    at = _put(plain, at, code, 4)
    count = 0 if remote else _LENGTHS[code]
    for index in range(count):
        at = _put(plain, at, payload[index] if index < length else 0, 8)
    if not fd:
        at = _put(plain, at, _crc(plain, at, 0, CRC15, 15), 15)
    end, run, last, data_from, stuffed = 0, 0, -1, 0, 0
    for index in range(at):
        if index == switch_at:
            data_from = end
        bit = plain[index]
        out[end] = bit
        end += 1
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5 and (not fd or index < at - 1):
            last = 1 - bit
            out[end] = last
            end += 1
            run = 1
            stuffed += 1
    if fd:
        gray = stuffed % 8 ^ (stuffed % 8) >> 1
        parity = (gray ^ gray >> 1 ^ gray >> 2) & 1
        field = gray << 1 | parity
        width = 17 if count <= 16 else 21
        polynomial = _CRC17 if count <= 16 else _CRC21
        # the checksum covers the stuffed bits and the stuff count, not the fixed stuff bits
        head = end
        end = _put(out, end, field, 4)
        field = field << width | _crc(out, end, 1 << (width - 1), polynomial, width)
        end = head
        for index in range(width + 4):
            if index % 4 == 0:
                out[end] = 1 - out[end - 1]
                end += 1
            out[end] = field >> (width + 3 - index) & 1
            end += 1
    data_to = end + 1 if data_from else 0
    end = _put(out, end, 0b101, 3)
    end = _put(out, end, 0x7F, 7)
    return end, data_from, data_to
