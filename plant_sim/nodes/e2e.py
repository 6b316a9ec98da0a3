"""AUTOSAR end-to-end protection, profile 1 variant 1A, on 8-byte payload words.

CRC-8 SAE J1850 over both bytes of the data id (low byte first) and payload bytes 1 to 7, in
byte 0; a counter from 0 to 14 in the low nibble of byte 1. The receiver's state machine is
E2E_P01Check of the AUTOSAR E2E protocol specification (PRS_E2EProtocol, profile 1). A counter of
15, which no sender may use, is answered like a wrong CRC.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels.jit import njit

COUNTERS = 15

# Check results, in the order of the specification's status codes' severity.
OK, SOME_LOST, INITIAL, SYNC, REPEATED, WRONG_SEQUENCE, WRONG_CRC = range(7)
# Slots of the receiver's state vector.
WAIT_FOR_FIRST, MAX_DELTA, LAST_COUNTER, SYNC_LEFT, NOT_NEW, LOST, N_STATE = range(7)


class Supervision(NamedTuple):
    """Receiver configuration of one protected message (names of the AUTOSAR configuration)."""

    max_delta_counter_init: int = 3
    max_no_new_or_repeated_data: int = 14
    sync_counter_init: int = 1


def _table() -> NDArray[np.int64]:
    table = np.zeros(256, dtype=np.int64)
    for byte in range(256):
        register = byte
        for _ in range(8):
            register = (register << 1) ^ (0x11D if register & 0x80 else 0)
        table[byte] = register
    return table


_CRC8 = _table()


@njit
def checksum(data_id: int, word: int) -> int:
    """CRC-8 of ``data_id`` (both bytes) and bytes 1 to 7 of the payload ``word``."""
    crc = _CRC8[data_id & 0xFF]
    crc = _CRC8[crc ^ ((data_id >> 8) & 0xFF)]
    for byte in range(1, 8):
        crc = _CRC8[crc ^ ((word >> (8 * byte)) & 0xFF)]
    return int(crc)


@njit
def protect(data_id: int, counter: int, word: int) -> int:
    """Return ``word`` with ``counter`` (0 to 14) and the checksum written into it."""
    counted = (word & ~0xFFF) | (counter << 8)
    return int(counted | checksum(data_id, counted))


@njit
def check(state: NDArray[np.int64], supervision: Supervision, data_id: int, word: int) -> int:
    """Judge a received payload and advance the receiver's ``state``; returns a status code."""
    state[MAX_DELTA] = min(state[MAX_DELTA] + 1, COUNTERS - 1)
    counter = (word >> 8) & 0xF
    if counter >= COUNTERS or (word & 0xFF) != checksum(data_id, word):
        return WRONG_CRC
    if state[WAIT_FOR_FIRST]:
        state[WAIT_FOR_FIRST] = 0
        state[MAX_DELTA] = supervision.max_delta_counter_init
        state[LAST_COUNTER] = counter
        return INITIAL
    delta = (counter - state[LAST_COUNTER]) % COUNTERS
    if delta == 0:
        state[NOT_NEW] = min(state[NOT_NEW] + 1, COUNTERS - 1)
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
