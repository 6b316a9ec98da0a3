"""Signals to payloads and back on arrays, with tables read from the DBC.

A payload is one 64-bit integer whose bit i is bit i of the DBC's Intel numbering: byte 0 of the
frame is the lowest byte. Physical values are rounded to the nearest raw value and clipped to the
range the DBC allows, which leaves out the two codes that mean error and not available.
"""

import math
from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
from cantools.database.can import Message, Signal
from numpy.typing import NDArray

import dbc
from canroll.errors import CanrollError, UnknownNameError
from plant_sim.kernels.jit import njit

# Columns of Codec.message.
IDENT, LENGTH, FIRST, END, DATA_ID, CYCLE_MS = range(6)
# Columns of Codec.field. PAGE is -1 where the signal is in every frame of its message.
START, WIDTH, SIGNED, RAW_MIN, RAW_MAX, RAW_ERROR, PAGE, PAGE_SIGNAL = range(8)
# Columns of Codec.scaling.
SCALE, OFFSET = range(2)


class Codec(NamedTuple):
    """Layout of every message: ``message`` (m, 6), ``field`` (n, 8), ``scaling`` (n, 2)."""

    message: NDArray[np.int64]
    field: NDArray[np.int64]
    scaling: NDArray[np.float64]


@njit
def raw_value(codec: Codec, signal: int, value: float) -> int:
    """Raw integer nearest to the physical ``value``, clipped; not a number gives the error code."""
    field = codec.field[signal]
    if math.isnan(value):
        return int(field[RAW_ERROR])
    scaled = (value - codec.scaling[signal, OFFSET]) / codec.scaling[signal, SCALE]
    if scaled <= field[RAW_MIN]:
        return int(field[RAW_MIN])
    if scaled >= field[RAW_MAX]:
        return int(field[RAW_MAX])
    nearest: int = math.floor(scaled + 0.5)
    return nearest


@njit
def insert(codec: Codec, signal: int, word: int, raw: int) -> int:
    """Return ``word`` with the bits of ``signal`` replaced by ``raw`` (two's complement)."""
    start = codec.field[signal, START]
    mask = (1 << codec.field[signal, WIDTH]) - 1
    return int((word & ~(mask << start)) | ((raw & mask) << start))


@njit
def extract(codec: Codec, signal: int, word: int) -> int:
    """Raw value of ``signal`` in the payload ``word``."""
    width = codec.field[signal, WIDTH]
    raw = (word >> codec.field[signal, START]) & ((1 << width) - 1)
    if codec.field[signal, SIGNED] and raw >> (width - 1):
        raw -= 1 << width
    return int(raw)


@njit
def encode(codec: Codec, message: int, values: NDArray[np.float64]) -> int:
    """Payload word of physical ``values``, one for each signal of ``message`` in table order."""
    first, end = codec.message[message, FIRST], codec.message[message, END]
    word = 0
    for signal in range(first, end):
        page = codec.field[signal, PAGE]
        if page < 0 or int(values[codec.field[signal, PAGE_SIGNAL] - first]) == page:
            word = insert(codec, signal, word, raw_value(codec, signal, values[signal - first]))
    return word


@njit
def decode(codec: Codec, message: int, word: int, values: NDArray[np.float64]) -> None:
    """Fill ``values`` with the physical values of ``message``; signals of other pages are nan."""
    first, end = codec.message[message, FIRST], codec.message[message, END]
    for signal in range(first, end):
        page = codec.field[signal, PAGE]
        if page >= 0 and extract(codec, codec.field[signal, PAGE_SIGNAL], word) != page:
            values[signal - first] = math.nan
        else:
            raw = extract(codec, signal, word)
            values[signal - first] = (
                raw * codec.scaling[signal, SCALE] + codec.scaling[signal, OFFSET]
            )


@njit
def valid(codec: Codec, signal: int, raw: int) -> bool:
    """Whether ``raw`` is a value rather than the error or the not-available code."""
    return bool(codec.field[signal, RAW_MIN] <= raw <= codec.field[signal, RAW_MAX])


@cache
def _messages() -> Mapping[str, Message]:
    return {message.name: message for message in dbc.load().messages}


def message_index(name: str) -> int:
    """Row of the message ``name`` in the tables."""
    if name not in _messages():
        raise UnknownNameError("message", name, _messages())
    return list(_messages()).index(name)


def signal_index(message: str, signal: str) -> int:
    """Row of a signal in the tables."""
    first = int(load().message[message_index(message), FIRST])
    names = [entry.name for entry in _messages()[message].signals]
    if signal not in names:
        raise UnknownNameError(f"signal of {message}", signal, names)
    return first + names.index(signal)


def signal_names(message: str) -> list[str]:
    """Names of the signals of ``message`` in table order."""
    message_index(message)
    return [signal.name for signal in _messages()[message].signals]


def unit(message: str, signal: str) -> str:
    """Unit of a signal as the DBC writes it, empty where it has none."""
    signal_index(message, signal)
    return _messages()[message].get_signal_by_name(signal).unit or ""


def _field(signal: Signal, first: int, names: list[str]) -> list[int]:
    if signal.byte_order != "little_endian" or signal.is_float:
        raise CanrollError(f"signal '{signal.name}' in {dbc.PATH.name}: use Intel-order integers")
    codes = {str(text): int(raw) for raw, text in (signal.choices or {}).items()}
    top = (1 << (signal.length - int(signal.is_signed))) - 1
    bottom = -top - 1 if signal.is_signed else 0
    scale, offset = float(signal.scale), float(signal.offset)
    low = bottom if signal.minimum is None else round((float(signal.minimum) - offset) / scale)
    high = top if signal.maximum is None else round((float(signal.maximum) - offset) / scale)
    page = signal.multiplexer_ids[0] if signal.multiplexer_ids else -1
    switch = first + (names.index(signal.multiplexer_signal) if signal.multiplexer_signal else 0)
    return [
        signal.start,
        signal.length,
        int(signal.is_signed),
        low,
        high,
        codes.get("Error", top),
        page,
        switch,
    ]


@cache
def load() -> Codec:
    """Tables of every message of ``roll_control.dbc``, in the file's order."""
    rows: list[list[int]] = []
    fields: list[list[int]] = []
    scaling: list[list[float]] = []
    for message in _messages().values():
        names = [signal.name for signal in message.signals]
        first = len(fields)
        rows.append(
            [
                message.frame_id,
                message.length,
                first,
                first + len(names),
                dbc.data_id(message),
                message.cycle_time or 0,
            ]
        )
        fields.extend(_field(signal, first, names) for signal in message.signals)
        scaling.extend([float(s.scale), float(s.offset)] for s in message.signals)
    return Codec(
        np.array(rows, dtype=np.int64),
        np.array(fields, dtype=np.int64),
        np.array(scaling, dtype=np.float64),
    )
