"""Conversion of signals to payloads and back on arrays, for the frames of any bus.

Tables have a row for every message and signal of the bus contract, in its file's order, whatever
frames they are sent in: those of ``roll_control.dbc``, or those of a user's DBC that a map places
the same signals in. Physical values are in the contract's units; they are rounded to the nearest
raw code and clipped to the DBC's range, which excludes the codes for error and not
available. A payload is an array of bytes.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels.jit import njit
from plant_sim.nodes import float32

MAX_PAYLOAD = 64
# Columns of Codec.message; LENGTH 0: the message is not on this bus. KEY is the identifier as the
# firmware has it (bit 30: one of 29 bits). LEADER is the first message in the same frame. SELECTOR
# is the row of the signal that is always SELECTED, as the frame has pages, -1: none. CONTRACT is
# the row of the message in the contract, another one for its further frames.
(
    IDENT,
    LENGTH,
    FIRST,
    END,
    CYCLE_NS,
    FLAGS,
    KEY,
    LEADER,
    SELECTOR,
    SELECTED,
    CONTRACT,
    N_MESSAGE,
) = range(12)
# Columns of Codec.field. PAGE is -1 where the signal is in every frame of its message. MINUS and
# TWIN are rows of the signals that carry the sign and the redundant or inverted code, -1: none.
# FRAME is the row of the message in whose frame the signal is. ALIKE is the row of the next signal
# with the same value, VALIDITY that of the signal that says by its code whether there is a value.
# PARTED: the next signal has the rest of the value, not the same.
# REAL: the raw code is the bits of a floating-point number.
(
    PIECES,
    WIDTH,
    SIGNED,
    RAW_MIN,
    RAW_MAX,
    RAW_ERROR,
    PAGE,
    PAGE_SIGNAL,
    MINUS,
    TWIN,
    INVERTED,
    TOLERANCE,
    FRAME,
    ALIKE,
    VALIDITY,
    VALID_CODE,
    INVALID_CODE,
    REAL,
    PARTED,
    N_FIELD,
) = range(20)
NO_ERROR_CODE = -(1 << 40)
"""Value for a signal without a code for error or not available in the DBC."""
OF_THE_FRAME = frozenset({"Checksum", "Counter", "SampleCounter"})
"""Signals of the contract that are specific to each frame."""
# Columns of Codec.scaling. REST is what the next signals carry in the middle of their ranges.
SCALE, OFFSET, REST = range(3)
# Columns of Codec.piece: bits of a signal in one byte.
BYTE, BIT, BITS, SIGNAL_BIT, N_PIECE = range(5)


class Codec(NamedTuple):
    """Layout of every message.

    ``message`` (m, 12), ``field`` (n, 20), ``piece`` (n, 5, 4), ``scaling`` (n, 3), ``protection``,
    ``terms`` and ``crc`` as in :mod:`plant_sim.nodes.e2e`.
    """

    message: NDArray[np.int64]
    field: NDArray[np.int64]
    piece: NDArray[np.int64]
    scaling: NDArray[np.float64]
    protection: NDArray[np.int64]
    terms: NDArray[np.int64]
    crc: NDArray[np.int64]


@njit
def raw_value(codec: Codec, signal: int, value: float) -> int:
    """Raw code nearest to the physical ``value``, clipped; NaN gives the error code."""
    field = codec.field[signal]
    if math.isnan(value):
        return int(field[RAW_ERROR])
    scaled = (value - codec.scaling[signal, OFFSET]) / codec.scaling[signal, SCALE]
    if field[REAL]:
        low, high = float32.number_of(field[RAW_MIN]), float32.number_of(field[RAW_MAX])
        return float32.code_of(min(max(scaled, low), high))
    if scaled <= field[RAW_MIN]:
        return int(field[RAW_MIN])
    if scaled >= field[RAW_MAX]:
        return int(field[RAW_MAX])
    nearest: int = math.floor(scaled + 0.5)
    return nearest


@njit
def _insert(codec: Codec, signal: int, payload: NDArray[np.uint8], raw: int) -> None:
    for k in range(codec.field[signal, PIECES]):
        piece = codec.piece[signal, k]
        mask = ((1 << piece[BITS]) - 1) << piece[BIT]
        part = ((raw >> piece[SIGNAL_BIT]) << piece[BIT]) & mask
        payload[piece[BYTE]] = (int(payload[piece[BYTE]]) & ~mask) | part


@njit
def _extract(codec: Codec, signal: int, payload: NDArray[np.uint8]) -> int:
    raw = 0
    for k in range(codec.field[signal, PIECES]):
        piece = codec.piece[signal, k]
        part = (int(payload[piece[BYTE]]) >> piece[BIT]) & ((1 << piece[BITS]) - 1)
        raw |= part << piece[SIGNAL_BIT]
    width = codec.field[signal, WIDTH]
    if codec.field[signal, SIGNED] and raw >> (width - 1):
        raw -= 1 << width
    return raw


@njit
def insert(codec: Codec, signal: int, payload: NDArray[np.uint8], raw: int) -> None:
    """Replace the bits of ``signal``, and of those that belong to it, in a payload by ``raw``."""
    field = codec.field[signal]
    size = raw
    if field[MINUS] >= 0:
        size = abs(raw)
        _insert(codec, field[MINUS], payload, 1 if raw < 0 else 0)
    _insert(codec, signal, payload, size)
    if field[TWIN] >= 0:
        _insert(codec, field[TWIN], payload, ~size if field[INVERTED] else size)
    if field[VALIDITY] >= 0:
        _insert(codec, field[VALIDITY], payload, field[VALID_CODE])


@njit
def put(codec: Codec, message: int, signal: int, payload: NDArray[np.uint8], raw: int) -> None:
    """Insert a signal in a payload of the frame in row ``message``, if that frame has it."""
    if codec.field[signal, FRAME] == message:
        insert(codec, signal, payload, raw)


@njit
def put_value(
    codec: Codec, message: int, signal: int, payload: NDArray[np.uint8], value: float
) -> None:
    """Insert a physical value, and in all signals that have the same or a part of it."""
    if codec.field[signal, FRAME] != message:
        return
    while signal >= 0:
        raw = raw_value(codec, signal, value - codec.scaling[signal, REST])
        insert(codec, signal, payload, raw)
        if codec.field[signal, PARTED]:
            value -= physical(codec, signal, raw)
        signal = codec.field[signal, ALIKE]


@njit
def invalidate(codec: Codec, message: int, signal: int, payload: NDArray[np.uint8]) -> None:
    """Say that a signal, and all that have the same value, have none."""
    if codec.field[signal, FRAME] != message:
        return
    while signal >= 0:
        if codec.field[signal, VALIDITY] >= 0:
            invalid = codec.field[signal, INVALID_CODE]
            _insert(codec, codec.field[signal, VALIDITY], payload, invalid)
        signal = codec.field[signal, ALIKE]


@njit
def extract(codec: Codec, signal: int, payload: NDArray[np.uint8]) -> int:
    """Raw value of ``signal`` in a payload."""
    raw: int = _extract(codec, signal, payload)
    minus = codec.field[signal, MINUS]
    if minus >= 0 and _extract(codec, minus, payload) == 1:
        return -raw
    return raw


@njit
def agrees(codec: Codec, signal: int, payload: NDArray[np.uint8]) -> bool:
    """Whether the redundant or inverted code, if any, agrees with ``signal``."""
    field = codec.field[signal]
    if field[TWIN] < 0:
        return True
    other: int = _extract(codec, field[TWIN], payload)
    if field[INVERTED]:
        other = ~other if field[SIGNED] else (1 << field[WIDTH]) - 1 - other
    return bool(abs(_extract(codec, signal, payload) - other) <= field[TOLERANCE])


@njit
def encode(
    codec: Codec, message: int, values: NDArray[np.float64], payload: NDArray[np.uint8]
) -> None:
    """Put physical ``values``, one for each signal of ``message`` in table order, in a payload."""
    first, end = codec.message[message, FIRST], codec.message[message, END]
    for signal in range(first, end):
        page = codec.field[signal, PAGE]
        if page < 0 or int(values[codec.field[signal, PAGE_SIGNAL] - first]) == page:
            insert(codec, signal, payload, raw_value(codec, signal, values[signal - first]))


@njit
def physical(codec: Codec, signal: int, raw: int) -> float:
    """Physical value of a raw code; nan for a floating-point number that is none."""
    number = float32.number_of(raw) if codec.field[signal, REAL] else float(raw)
    return float(number * codec.scaling[signal, SCALE] + codec.scaling[signal, OFFSET])


@njit
def decode(
    codec: Codec, message: int, payload: NDArray[np.uint8], values: NDArray[np.float64]
) -> None:
    """Fill ``values`` with the physical values of ``message``; signals of other pages are nan."""
    first, end = codec.message[message, FIRST], codec.message[message, END]
    for signal in range(first, end):
        page = codec.field[signal, PAGE]
        if page >= 0 and extract(codec, codec.field[signal, PAGE_SIGNAL], payload) != page:
            values[signal - first] = math.nan
        else:
            values[signal - first] = physical(codec, signal, extract(codec, signal, payload))


@njit
def valid(codec: Codec, signal: int, raw: int) -> bool:
    """Whether ``raw`` is a value rather than the error or the not-available code."""
    if codec.field[signal, REAL]:
        return float32.finite(raw)
    return bool(codec.field[signal, RAW_MIN] <= raw <= codec.field[signal, RAW_MAX])
