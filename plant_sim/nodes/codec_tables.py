"""The tables of the codec: those of the bus contract, and those of the frames of a user's map."""

from collections.abc import Iterator, Mapping
from functools import cache

import numpy as np
from cantools.database.can import Message, Signal

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
from plant_sim.kernels.instants import MS
from plant_sim.nodes import e2e, float32
from plant_sim.nodes.codec import (
    ALIKE,
    CONTRACT,
    CYCLE_NS,
    END,
    FIRST,
    FLAGS,
    FRAME,
    IDENT,
    INVALID_CODE,
    INVERTED,
    KEY,
    LEADER,
    LENGTH,
    MINUS,
    N_FIELD,
    N_MESSAGE,
    N_PIECE,
    NO_ERROR_CODE,
    OF_THE_FRAME,
    PAGE,
    PAGE_SIGNAL,
    PARTED,
    PIECES,
    RAW_ERROR,
    RAW_MAX,
    RAW_MIN,
    REAL,
    REST,
    SELECTED,
    SELECTOR,
    SIGNED,
    TOLERANCE,
    TWIN,
    VALID_CODE,
    VALIDITY,
    WIDTH,
    Codec,
    physical,
)

_PIECES = 5
_SPARE = 64
"""Rows for signals that belong to others: tables of all buses have one shape."""


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
        np.tile([1.0, 1.0, 0.0], (signals + _SPARE, 1)),
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
    codec.scaling[row, :REST] = scale, offset


@cache
def load() -> Codec:
    """Tables of every message of ``roll_control.dbc``, in the file's order."""
    codec = _empty()
    for index, message in enumerate(_messages().values()):
        row = codec.message[index]
        row[[IDENT, LENGTH, KEY]] = message.frame_id, message.length, message.frame_id
        row[CYCLE_NS] = (message.cycle_time or 0) * MS
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
        row[CYCLE_NS] = round(box.cycle_ms * MS)
        row[LEADER] = leaders.setdefault(box.ident, index)
        e2e.put(codec.protection[index], codec.terms[index], codec.crc[index], box.protection)
        summed = {signal.place.text for signal in box.signals if signal.added}
        # of a sum the finest last: it has the rest
        for signal in sorted(box.signals, key=lambda its: -its.step):
            if signal.place.text not in names.signals:
                continue
            name = names.signals[signal.place.text]
            first = at = signal_index(names.message, name)
            if codec.field[at, PIECES]:
                # a mean of several: the same value is in each; a sum: each has a part of it
                last = first
                while codec.field[last, ALIKE] >= 0:
                    last = codec.field[last, ALIKE]
                codec.field[last, ALIKE] = spare
                at, spare = spare, spare + 1
            _place(codec, at, signal)
            codec.field[at, FRAME] = index
            _scale(codec, at, signal, unit(names.message, name))
            if signal.place.text in summed:
                codec.field[at, PARTED] = 1
                while first != at:
                    limits = codec.field[at, [RAW_MIN, RAW_MAX]].tolist()
                    codec.scaling[first, REST] += sum(physical(codec, at, n) for n in limits) / 2
                    first = codec.field[first, ALIKE]
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
    codec.scaling[row, :REST] = float(signal.scale) * factor, float(signal.offset) * factor
    low, high = signal.raw_lo, signal.raw_hi
    while high in signal.unavailable:
        high -= 1
    while low in signal.unavailable:
        low += 1
    error = signal.unavailable[0] if signal.unavailable else NO_ERROR_CODE
    error = float32.NOT_A_NUMBER if signal.real else error
    codec.field[row, [RAW_MIN, RAW_MAX, RAW_ERROR, REAL]] = low, high, error, signal.real
