"""Conversion of signals to payloads and back on arrays, for the frames of any bus.

Tables have a row for every message and signal of the bus contract, in its file's order, whatever
frames they are sent in: those of ``roll_control.dbc``, or those of a user's DBC that a map places
the same signals in. Physical values are in the contract's units; they are rounded to the nearest
raw code and clipped to the DBC's range, which excludes the codes for error and not
available. A payload is an array of bytes.
"""

import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
from cantools.database.can import Message, Signal
from numpy.typing import NDArray

import dbc
from canroll.errors import UnknownNameError
from codegen.frame.frame_protection import protection
from codegen.frame.raw_signal import RawSignal, raw_signal
from codegen.frame.units import conversion
from codegen.generated.bus_map import BusMap
from codegen.generated.mailbox import EXTENDED as EXTENDED_IDENT
from codegen.generated.mailbox import Mailbox
from codegen.generated.mapped_signal import MappedSignal
from codegen.generated.second_signals import valid_codes
from plant_sim.can_bus.network.own_frames import FURTHER_FRAMES, contract_names, flags_of
from plant_sim.kernels.jit import njit
from plant_sim.nodes import e2e, float32

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
    CYCLE_MS,
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
    N_FIELD,
) = range(19)
NO_ERROR_CODE = -(1 << 40)
"""Value for a signal without a code for error or not available in the DBC."""
OF_THE_FRAME = frozenset({"Checksum", "Counter", "SampleCounter"})
"""Signals of the contract that are specific to each frame."""
# Columns of Codec.scaling.
SCALE, OFFSET = range(2)
# Columns of Codec.piece: bits of a signal in one byte.
BYTE, BIT, BITS, SIGNAL_BIT, N_PIECE = range(5)
_PIECES = 5
_SPARE = 64
"""Rows for signals that belong to others: tables of all buses have one shape."""


class Codec(NamedTuple):
    """Layout of every message.

    ``message`` (m, 12), ``field`` (n, 19), ``piece`` (n, 5, 4), ``scaling`` (n, 2), ``protection``,
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
    """Insert a physical value, and in all signals that have the same."""
    if codec.field[signal, FRAME] != message:
        return
    while signal >= 0:
        insert(codec, signal, payload, raw_value(codec, signal, value))
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
    """Unit of a signal as written in the DBC, empty if it has none."""
    signal_index(message, signal)
    return _messages()[message].get_signal_by_name(signal).unit or ""


def _empty() -> Codec:
    """Tables of a bus without any message."""
    messages = _messages()
    signals = sum(len(message.signals) for message in messages.values())
    rows = len(messages) + FURTHER_FRAMES
    codec = Codec(
        np.zeros((rows, N_MESSAGE), dtype=np.int64),
        np.zeros((signals + _SPARE, N_FIELD), dtype=np.int64),
        np.zeros((signals + _SPARE, _PIECES, N_PIECE), dtype=np.int64),
        np.ones((signals + _SPARE, 2)),
        *e2e.tables(rows),
    )
    codec.message[:, [KEY, SELECTOR, CONTRACT]] = -1
    codec.message[:, LEADER] = range(rows)
    codec.field[:, [PAGE, MINUS, TWIN, FRAME, ALIKE, VALIDITY]] = -1
    first = 0
    for index, message in enumerate(messages.values()):
        end = first + len(message.signals)
        codec.message[index, [FIRST, END, CONTRACT]] = first, end, index
        codec.field[first:end, FRAME] = index
        first = end
    return codec


def _place(codec: Codec, row: int, signal: RawSignal) -> None:
    codec.field[row, [PIECES, WIDTH, SIGNED]] = len(signal.pieces), signal.length, signal.signed
    for k, piece in enumerate(signal.pieces):
        codec.piece[row, k] = piece.byte, piece.bit, piece.width, piece.signal_bit


def _contract_field(codec: Codec, row: int, signal: Signal, first: int, names: list[str]) -> None:
    codes = {str(text): int(raw) for raw, text in (signal.choices or {}).items()}
    top = (1 << (signal.length - int(signal.is_signed))) - 1
    bottom = -top - 1 if signal.is_signed else 0
    scale, offset = float(signal.scale), float(signal.offset)
    low = bottom if signal.minimum is None else round((float(signal.minimum) - offset) / scale)
    high = top if signal.maximum is None else round((float(signal.maximum) - offset) / scale)
    _place(codec, row, raw_signal(signal))
    codec.field[row, [RAW_MIN, RAW_MAX, RAW_ERROR]] = low, high, codes.get("Error", top)
    if signal.multiplexer_ids:
        codec.field[row, PAGE] = signal.multiplexer_ids[0]
    if signal.multiplexer_signal:
        codec.field[row, PAGE_SIGNAL] = first + names.index(signal.multiplexer_signal)
    else:
        codec.field[row, PAGE_SIGNAL] = first
    codec.scaling[row] = scale, offset


@cache
def load() -> Codec:
    """Tables of every message of ``roll_control.dbc``, in the file's order."""
    codec = _empty()
    for index, message in enumerate(_messages().values()):
        row = codec.message[index]
        row[[IDENT, LENGTH, KEY]] = message.frame_id, message.length, message.frame_id
        row[CYCLE_MS] = message.cycle_time or 0
        names = [signal.name for signal in message.signals]
        for k, signal in enumerate(message.signals):
            _contract_field(codec, int(row[FIRST]) + k, signal, int(row[FIRST]), names)
        terms = protection(message, None, (), dbc.PATH.name)
        e2e.put(codec.protection[index], codec.terms[index], codec.crc[index], terms)
    return codec


def of_map(bus: BusMap, frames: Mapping[int, Mapping[str, Signal]] | None = None) -> Codec:
    """Tables of the frames in which ``bus`` places the contract's signals.

    Messages without a mailbox in the map, and signals that it leaves out, are not on the bus,
    unless a frame of the map has them under the contract's name and unit: ``frames`` are the
    signals of each, by its identifier.
    """
    codec = _empty()
    spare = len(codec.field) - _SPARE
    leaders: dict[int, int] = {}
    free = len(_messages())
    for box in bus.frames:
        names = contract_names(box.slot)
        index = message_index(names.message)
        if box.further:
            codec.message[free, CONTRACT] = index
            index, free = free, free + 1
        row = codec.message[index]
        row[KEY] = box.ident
        row[IDENT], row[LENGTH] = box.ident & (EXTENDED_IDENT - 1), box.sent_length
        row[FLAGS] = flags_of(box)
        row[CYCLE_MS] = box.cycle_ms
        row[LEADER] = leaders.setdefault(box.ident, index)
        e2e.put(codec.protection[index], codec.terms[index], codec.crc[index], box.protection)
        for signal in box.signals:
            if signal.place.text not in names.signals:
                continue
            name = names.signals[signal.place.text]
            at = signal_index(names.message, name)
            if codec.field[at, PIECES]:
                # a mean of several: the same value is in each
                codec.field[spare, ALIKE] = codec.field[at, ALIKE]
                codec.field[at, ALIKE] = spare
                at, spare = spare, spare + 1
            _place(codec, at, signal)
            codec.field[at, FRAME] = index
            _scale(codec, at, signal, unit(names.message, name))
            others: dict[int, RawSignal | None] = {
                MINUS: signal.minus,
                TWIN: signal.twin.signal if signal.twin else None,
                VALIDITY: signal.validity.signal if signal.validity else None,
            }
            for column, other in others.items():
                if other is not None:
                    _place(codec, spare, other)
                    codec.field[at, column] = spare
                    spare += 1
            if signal.validity is not None:
                # what the signals that share it have in common: one code says it of all of them
                codes = valid_codes(box.signals)[signal.validity.signal.name]
                codec.field[at, [VALID_CODE, INVALID_CODE]] = codes[0], _missing(codes)
            if signal.twin is not None:
                codec.field[at, [INVERTED, TOLERANCE]] = (
                    signal.twin.inverted,
                    signal.twin.tolerance,
                )
        if box.selector is not None:
            _place(codec, spare, box.selector)
            row[[SELECTOR, SELECTED]] = spare, box.pages[0]
            spare += 1
    for ident, leader in leaders.items():
        mapped = {part.name for b in bus.frames if b.ident == ident for part in _parts(b)}
        there = (frames or {}).get(ident, {})
        _place_rest(codec, leader, {n: signal for n, signal in there.items() if n not in mapped})
    return codec


def _missing(codes: tuple[int, ...]) -> int:
    """The least code that is none of those by which a signal is valid."""
    return next(code for code in range(len(codes) + 1) if code not in codes)


def _parts(box: Mailbox) -> Iterator[RawSignal]:
    for signal in box.signals:
        yield from signal.parts


def _place_rest(codec: Codec, leader: int, rest: Mapping[str, Signal]) -> None:
    """Map further signals of the contract that a frame contains in addition to those of the map."""
    for index, message in enumerate(_messages().values()):
        row = codec.message[index]
        if row[LENGTH] and row[LEADER] != leader:
            continue
        candidates = {
            signal.name: rest[signal.name]
            for signal in message.signals
            if signal.name in rest
            and (rest[signal.name].unit or "") == (signal.unit or "")
            and signal.name not in OF_THE_FRAME
        }
        values = {signal.name for signal in message.signals} - OF_THE_FRAME
        if not row[LENGTH] and candidates.keys() == values:
            own = row[[FIRST, END, CONTRACT]].copy()
            row[:] = codec.message[leader]
            row[[FIRST, END, CONTRACT]] = own
        if row[LENGTH]:
            names = [signal.name for signal in message.signals]
            for name, signal in candidates.items():
                at, first = signal_index(message.name, name), int(row[FIRST])
                _contract_field(codec, at, signal, first, names)


def _scale(codec: Codec, row: int, signal: MappedSignal, contract_unit: str) -> None:
    """Scaling in the contract's unit, and the range of valid codes."""
    factor = float(conversion(signal.place.unit, contract_unit, signal.name, dbc.PATH.name))
    factor /= 2**signal.place.q
    codec.scaling[row] = float(signal.scale) * factor, float(signal.offset) * factor
    low, high = signal.raw_lo, signal.raw_hi
    while high in signal.unavailable:
        high -= 1
    while low in signal.unavailable:
        low += 1
    error = signal.unavailable[0] if signal.unavailable else NO_ERROR_CODE
    error = float32.NOT_A_NUMBER if signal.real else error
    codec.field[row, [RAW_MIN, RAW_MAX, RAW_ERROR, REAL]] = low, high, error, signal.real
