"""End-to-end protection of the plant's frames: checksums, counters and their receiver.

It covers everything in :class:`codegen.generated.frame_protection.Protection`: AUTOSAR E2E profiles
1, 2, 5 and 22, and manufacturers' schemes. The receiver's state machine is E2E_P01Check of the
AUTOSAR E2E protocol specification (PRS_E2EProtocol, profile 1), for counters of any number of
values. A counter
beyond its last value, which no sender may use, is treated like a wrong checksum.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from codegen.generated.frame_protection import Protection, crc_table
from plant_sim.kernels.jit import njit

# Columns of a protection. FIRST and LAST: two identity bytes each, taken in before and after the
# frame. VALUES 0: no counter. NIBBLE: bit that carries bits 8 to 11 of the data id, -1: none.
(
    METHOD,
    BYTE,
    SIZE,
    START,
    FINAL,
    COVERED,
    FIRST,
    LAST,
    DATA_ID,
    COUNTER_BYTE,
    COUNTER_BIT,
    COUNTER_WIDTH,
    VALUES,
    NIBBLE,
    N_PROTECTION,
) = (0, 1, 2, 3, 4, 5, 6, 8, 10, 11, 12, 13, 14, 15, 16)
NO_CHECKSUM, XOR, SUM, CRC8, CRC16 = range(5)
_METHODS = {"xor": XOR, "sum": SUM, "crc8": CRC8, "crc16": CRC16}
# Identity bytes.
NOTHING, LOW, HIGH, ZERO, ALTERNATING, LISTED = range(6)
_IDENTITIES = {"low": LOW, "high": HIGH, "zero": ZERO, "alternating": ALTERNATING, "listed": LISTED}

# Check results, in the order of the specification's status codes' severity.
OK, SOME_LOST, INITIAL, SYNC, REPEATED, WRONG_SEQUENCE, WRONG_CRC = range(7)
# Slots of the receiver's state vector.
WAIT_FOR_FIRST, MAX_DELTA, LAST_COUNTER, SYNC_LEFT, NOT_NEW, LOST, N_STATE = range(7)


# Where the receiver's two counts end: profile 1's, whose counter has 15 values.
WINDOW_MAX = NOT_NEW_MAX = 14


class Supervision(NamedTuple):
    """Receiver configuration of one protected message (names of the AUTOSAR configuration)."""

    max_delta_counter_init: int = 3
    max_no_new_or_repeated_data: int = 14
    sync_counter_init: int = 1


def tables(rows: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Empty tables for ``rows`` unprotected messages: protections, identities, CRC tables."""
    protection = np.zeros((rows, N_PROTECTION), dtype=np.int64)
    protection[:, NIBBLE] = -1
    return protection, np.zeros((rows, 16), np.int64), np.zeros((rows, 256), np.int64)


def put(
    row: NDArray[np.int64],
    identities: NDArray[np.int64],
    crc: NDArray[np.int64],
    its: Protection | None,
) -> None:
    """Write one protection into its rows of the tables."""
    if its is None:
        return
    row[COVERED] = its.length
    if isinstance(its.identity, tuple):
        identities[: len(its.identity)] = its.identity
    else:
        row[DATA_ID] = its.identity
    if its.nibble is not None:
        row[NIBBLE] = its.nibble
    if its.counter is not None:
        counter = its.counter
        row[[COUNTER_BYTE, COUNTER_BIT, COUNTER_WIDTH, VALUES]] = (
            counter.byte,
            counter.bit,
            counter.width,
            counter.values,
        )
    if its.checksum is not None:
        checksum = its.checksum
        row[[METHOD, BYTE, SIZE]] = _METHODS[checksum.method], checksum.byte, checksum.size
        row[[START, FINAL]] = checksum.start, checksum.end
        for first, names in ((FIRST, checksum.first), (LAST, checksum.last)):
            row[first : first + len(names)] = [_IDENTITIES[name] for name in names]
        if checksum.method in ("crc8", "crc16"):
            crc[:] = crc_table(checksum.polynomial, 8 * checksum.size)


@njit
def _identity(row: NDArray[np.int64], identities: NDArray[np.int64], which: int, count: int) -> int:
    if which == LISTED:
        return int(identities[count % 16])
    if which == ZERO:
        return 0
    high = which == HIGH or (which == ALTERNATING and count % 2 == 1)
    return int((row[DATA_ID] >> (8 if high else 0)) & 255)


@njit
def _step(row: NDArray[np.int64], crc: NDArray[np.int64], value: int, byte: int) -> int:
    method = row[METHOD]
    if method == XOR:
        return value ^ byte
    if method == SUM:
        return (value + byte) & 255
    if method == CRC8:
        return int(crc[value ^ byte])
    return int(((value << 8) & 0xFFFF) ^ crc[(value >> 8) ^ byte])


@njit
def checksum(
    row: NDArray[np.int64],
    identities: NDArray[np.int64],
    crc: NDArray[np.int64],
    payload: NDArray[np.uint8],
) -> int:
    """Checksum of a frame that has its counter."""
    count = counter_of(row, payload)
    value: int = row[START]
    for k in range(FIRST, FIRST + 2):
        if row[k] != NOTHING:
            value = _step(row, crc, value, _identity(row, identities, row[k], count))
    for k in range(row[COVERED]):
        if not row[BYTE] <= k < row[BYTE] + row[SIZE]:
            value = _step(row, crc, value, int(payload[k]))
    for k in range(LAST, LAST + 2):
        if row[k] != NOTHING:
            value = _step(row, crc, value, _identity(row, identities, row[k], count))
    return int(value ^ row[FINAL])


@njit
def counter_of(row: NDArray[np.int64], payload: NDArray[np.uint8]) -> int:
    """Counter of a frame; 0 if it has none."""
    mask = (1 << row[COUNTER_WIDTH]) - 1
    return int((int(payload[row[COUNTER_BYTE]]) >> row[COUNTER_BIT]) & mask)


@njit
def protect(
    row: NDArray[np.int64],
    identities: NDArray[np.int64],
    crc: NDArray[np.int64],
    count: int,
    payload: NDArray[np.uint8],
) -> None:
    """Write the counter of frame number ``count`` and the checksum into a payload."""
    if row[VALUES] > 0:
        mask = ((1 << row[COUNTER_WIDTH]) - 1) << row[COUNTER_BIT]
        kept = int(payload[row[COUNTER_BYTE]]) & ~mask
        payload[row[COUNTER_BYTE]] = kept | (count % row[VALUES]) << row[COUNTER_BIT]
    if row[NIBBLE] >= 0:
        byte, bit = row[NIBBLE] // 8, row[NIBBLE] % 8
        kept = int(payload[byte]) & ~(15 << bit)
        payload[byte] = kept | ((row[DATA_ID] >> 8) & 15) << bit
    if row[METHOD] != NO_CHECKSUM:
        value = checksum(row, identities, crc, payload)
        for k in range(row[SIZE]):
            payload[row[BYTE] + k] = (value >> (8 * k)) & 255


@njit
def intact(
    row: NDArray[np.int64],
    identities: NDArray[np.int64],
    crc: NDArray[np.int64],
    payload: NDArray[np.uint8],
) -> bool:
    """Whether a frame has its checksum, its data id and a counter that a sender may use."""
    if row[VALUES] > 0 and counter_of(row, payload) >= row[VALUES]:
        return False
    if row[NIBBLE] >= 0:
        found = (int(payload[row[NIBBLE] // 8]) >> (row[NIBBLE] % 8)) & 15
        if found != (row[DATA_ID] >> 8) & 15:
            return False
    if row[METHOD] == NO_CHECKSUM:
        return True
    value = 0
    for k in range(row[SIZE]):
        value |= int(payload[row[BYTE] + k]) << (8 * k)
    return bool(value == checksum(row, identities, crc, payload))


@njit
def check(  # noqa: PLR0917
    state: NDArray[np.int64],
    supervision: Supervision,
    row: NDArray[np.int64],
    identities: NDArray[np.int64],
    crc: NDArray[np.int64],
    payload: NDArray[np.uint8],
) -> int:
    """Judge a received payload and advance the receiver's ``state``; returns a status code.

    A frame without a counter is always in sequence.
    """
    values = row[VALUES]
    state[MAX_DELTA] = min(state[MAX_DELTA] + 1, WINDOW_MAX)
    if not intact(row, identities, crc, payload):
        return WRONG_CRC
    if values == 0:
        return OK
    counter = counter_of(row, payload)
    if state[WAIT_FOR_FIRST]:
        state[WAIT_FOR_FIRST] = 0
        state[MAX_DELTA] = supervision.max_delta_counter_init
        state[LAST_COUNTER] = counter
        return INITIAL
    delta = (counter - state[LAST_COUNTER]) % values
    if delta == 0:
        state[NOT_NEW] = min(state[NOT_NEW] + 1, NOT_NEW_MAX)
        return REPEATED
    if delta > state[MAX_DELTA]:
        state[NOT_NEW] = 0
        state[SYNC_LEFT] = supervision.sync_counter_init
        if supervision.sync_counter_init > 0:
            state[MAX_DELTA] = supervision.max_delta_counter_init
            state[LAST_COUNTER] = counter
        return WRONG_SEQUENCE
    state[MAX_DELTA] = supervision.max_delta_counter_init
    state[LAST_COUNTER] = counter
    state[LOST] = delta - 1
    if state[NOT_NEW] > supervision.max_no_new_or_repeated_data:
        state[NOT_NEW] = 0
        state[SYNC_LEFT] = supervision.sync_counter_init
        return SYNC
    state[NOT_NEW] = 0
    if state[SYNC_LEFT] > 0:
        state[SYNC_LEFT] -= 1
        return SYNC
    return OK if delta == 1 else SOME_LOST


def receiver_state(supervision: Supervision) -> NDArray[np.int64]:
    """State of a receiver that has seen nothing yet (E2E_P01CheckInit)."""
    state = np.zeros(N_STATE, dtype=np.int64)
    state[WAIT_FOR_FIRST] = 1
    state[MAX_DELTA] = supervision.max_delta_counter_init
    return state
