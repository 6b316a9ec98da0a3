"""Conversion of signals to payloads and back on arrays, for the frames of any bus.

Tables have a row for every message and signal of the bus contract, in its file's order, whatever
frames they are sent in: those of ``roll_control.dbc``, or those of a user's DBC that a map places
the same signals in. Physical values are in the contract's units; they are rounded to the nearest
raw code and clipped to the DBC's range, which excludes the codes for error and not
available. A payload is an array of bytes.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.records import fields
from canroll.plant_sim.nodes import float32

MAX_PAYLOAD = 64
NO_ERROR_CODE = -(1 << 40)
"""Value for a signal without a code for error or not available in the DBC."""
OF_THE_FRAME = frozenset({"Checksum", "Counter", "SampleCounter"})
"""Signals of the contract that are specific to each frame."""
MESSAGE = np.dtype(
    fields("i8", "ident length first end cycle_ns flags key leader selector selected contract")
)
"""A message; ``length`` 0: it is not on this bus.

``key`` is the identifier as the firmware has it (bit 30: one of 29 bits), ``leader`` the first
message in the same frame, ``selector`` the row of the signal that is always ``selected``, as the
frame has pages, -1: none; ``contract`` is the row of the message in the contract, another one for
its further frames.
"""
PIECE = np.dtype(fields("i8", "byte bit bits signal_bit"))
"""Bits of a signal in one byte."""
PIECES = 5
FIELD = np.dtype(
    [
        *fields(
            "i8", "pieces width has_sign raw_min raw_max raw_error page page_signal minus twin"
        ),
        *fields(
            "i8", "inverted tolerance frame alike validity valid_code invalid_code real parted"
        ),
        *fields("f8", "scale offset rest"),
        ("piece", PIECE, (PIECES,)),
    ]
)
"""A signal.

``page`` is -1 where it is in every frame of its message. ``minus`` and ``twin`` are rows of the
signals that carry the sign and the redundant or inverted code, -1: none. ``frame`` is the row of
the message in whose frame it is, ``alike`` that of the next signal with the same value,
``validity`` that of the signal that says by its code whether there is a value. ``parted``: the next
signal has the rest of the value, not the same; ``rest`` is what the next signals carry in the
middle of their ranges. ``real``: the raw code is the bits of a floating-point number.
"""


class Codec(NamedTuple):
    """Rows of MESSAGE and FIELD, and PROTECTION of :mod:`canroll.plant_sim.nodes.e2e`."""

    message: NDArray[Any]
    field: NDArray[Any]
    protection: NDArray[Any]


@njit
def raw_value(codec: Codec, signal: int, value: float) -> int:
    """Raw code nearest to the physical ``value``, clipped; NaN gives the error code."""
    field = codec.field[signal]
    if math.isnan(value):
        return int(field.raw_error)
    scaled = (value - field.offset) / field.scale
    if field.real:
        low, high = float32.number_of(field.raw_min), float32.number_of(field.raw_max)
        return float32.code_of(min(max(scaled, low), high))
    if scaled <= field.raw_min:
        return int(field.raw_min)
    if scaled >= field.raw_max:
        return int(field.raw_max)
    nearest: int = math.floor(scaled + 0.5)
    return nearest


@njit
def _insert(codec: Codec, signal: int, payload: NDArray[np.uint8], raw: int) -> None:
    for k in range(codec.field[signal].pieces):
        piece = codec.field[signal].piece[k]
        mask = ((1 << piece.bits) - 1) << piece.bit
        part = ((raw >> piece.signal_bit) << piece.bit) & mask
        payload[piece.byte] = (int(payload[piece.byte]) & ~mask) | part


@njit
def _extract(codec: Codec, signal: int, payload: NDArray[np.uint8]) -> int:
    raw = 0
    for k in range(codec.field[signal].pieces):
        piece = codec.field[signal].piece[k]
        part = (int(payload[piece.byte]) >> piece.bit) & ((1 << piece.bits) - 1)
        raw |= part << piece.signal_bit
    width = codec.field[signal].width
    if codec.field[signal].has_sign and raw >> (width - 1):
        raw -= 1 << width
    return raw


@njit
def insert(codec: Codec, signal: int, payload: NDArray[np.uint8], raw: int) -> None:
    """Replace the bits of ``signal``, and of those that belong to it, in a payload by ``raw``."""
    field = codec.field[signal]
    size = raw
    if field.minus >= 0:
        size = abs(raw)
        _insert(codec, field.minus, payload, 1 if raw < 0 else 0)
    _insert(codec, signal, payload, size)
    if field.twin >= 0:
        _insert(codec, field.twin, payload, ~size if field.inverted else size)
    if field.validity >= 0:
        _insert(codec, field.validity, payload, field.valid_code)


@njit
def put(codec: Codec, message: int, signal: int, payload: NDArray[np.uint8], raw: int) -> None:
    """Insert a signal in a payload of the frame in row ``message``, if that frame has it."""
    if codec.field[signal].frame == message:
        insert(codec, signal, payload, raw)


@njit
def put_value(
    codec: Codec, message: int, signal: int, payload: NDArray[np.uint8], value: float
) -> None:
    """Insert a physical value, and in all signals that have the same or a part of it."""
    if codec.field[signal].frame != message:
        return
    while signal >= 0:
        raw = raw_value(codec, signal, value - codec.field[signal].rest)
        insert(codec, signal, payload, raw)
        if codec.field[signal].parted:
            value -= physical(codec, signal, raw)
        signal = codec.field[signal].alike


@njit
def invalidate(codec: Codec, message: int, signal: int, payload: NDArray[np.uint8]) -> None:
    """Say that a signal, and all that have the same value, have none."""
    if codec.field[signal].frame != message:
        return
    while signal >= 0:
        if codec.field[signal].validity >= 0:
            invalid = codec.field[signal].invalid_code
            _insert(codec, codec.field[signal].validity, payload, invalid)
        signal = codec.field[signal].alike


@njit
def extract(codec: Codec, signal: int, payload: NDArray[np.uint8]) -> int:
    """Raw value of ``signal`` in a payload."""
    raw: int = _extract(codec, signal, payload)
    minus = codec.field[signal].minus
    if minus >= 0 and _extract(codec, minus, payload) == 1:
        return -raw
    return raw


@njit
def agrees(codec: Codec, signal: int, payload: NDArray[np.uint8]) -> bool:
    """Whether the redundant or inverted code, if any, agrees with ``signal``."""
    field = codec.field[signal]
    if field.twin < 0:
        return True
    other: int = _extract(codec, field.twin, payload)
    if field.inverted:
        other = ~other if field.has_sign else (1 << field.width) - 1 - other
    return bool(abs(_extract(codec, signal, payload) - other) <= field.tolerance)


@njit
def encode(
    codec: Codec, message: int, values: NDArray[np.float64], payload: NDArray[np.uint8]
) -> None:
    """Put physical ``values``, one for each signal of ``message`` in table order, in a payload."""
    first, end = codec.message[message].first, codec.message[message].end
    for signal in range(first, end):
        page = codec.field[signal].page
        if page < 0 or int(values[codec.field[signal].page_signal - first]) == page:
            insert(codec, signal, payload, raw_value(codec, signal, values[signal - first]))


@njit
def physical(codec: Codec, signal: int, raw: int) -> float:
    """Physical value of a raw code; nan for a floating-point number that is none."""
    number = float32.number_of(raw) if codec.field[signal].real else float(raw)
    return float(number * codec.field[signal].scale + codec.field[signal].offset)


@njit
def decode(
    codec: Codec, message: int, payload: NDArray[np.uint8], values: NDArray[np.float64]
) -> None:
    """Fill ``values`` with the physical values of ``message``; signals of other pages are nan."""
    first, end = codec.message[message].first, codec.message[message].end
    for signal in range(first, end):
        page = codec.field[signal].page
        if page >= 0 and extract(codec, codec.field[signal].page_signal, payload) != page:
            values[signal - first] = math.nan
        else:
            values[signal - first] = physical(codec, signal, extract(codec, signal, payload))


@njit
def valid(codec: Codec, signal: int, raw: int) -> bool:
    """Whether ``raw`` is a value rather than the error or the not-available code."""
    if codec.field[signal].real:
        return float32.finite(raw)
    return bool(codec.field[signal].raw_min <= raw <= codec.field[signal].raw_max)
