"""The tables of the codec: those of the bus contract, and those of the frames of a user's map."""

from collections.abc import Iterator, Mapping
from functools import cache

import numpy as np
from cantools.database.can import Message, Signal

from canroll import dbc
from canroll.codegen.frame.frame_protection import protection
from canroll.codegen.frame.raw_signal import RawSignal, raw_signal
from canroll.codegen.frame.units import conversion
from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.generated.mailbox import EXTENDED as EXTENDED_IDENT
from canroll.codegen.generated.mailbox import Mailbox
from canroll.codegen.generated.mapped_signal import MappedSignal
from canroll.codegen.generated.second_signals import valid_codes
from canroll.errors import UnknownNameError
from canroll.plant_sim.can_bus.network.own_frames import FURTHER_FRAMES, contract_names, flags_of
from canroll.plant_sim.kernels.instants import MS
from canroll.plant_sim.nodes import e2e, float32
from canroll.plant_sim.nodes.codec import (
    FIELD,
    MESSAGE,
    NO_ERROR_CODE,
    OF_THE_FRAME,
    Codec,
    physical,
)

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
    first = int(load().message[message_index(message)]["first"])
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
        np.zeros(rows, MESSAGE),
        np.zeros(signals + _SPARE, FIELD),
        np.zeros(rows, e2e.PROTECTION),
    )
    for name in ("key", "selector", "contract"):
        codec.message[name] = -1
    codec.message["leader"] = range(rows)
    for name in ("page", "minus", "twin", "frame", "alike", "validity"):
        codec.field[name] = -1
    codec.field["scale"] = codec.field["offset"] = 1.0
    first = 0
    for index, message in enumerate(messages.values()):
        end = first + len(message.signals)
        row = codec.message[index]
        row["first"], row["end"], row["contract"] = first, end, index
        codec.field[first:end]["frame"] = index
        first = end
    return codec


def _place(codec: Codec, row: int, signal: RawSignal) -> None:
    field = codec.field[row]
    field["pieces"], field["width"] = len(signal.pieces), signal.length
    field["has_sign"] = signal.signed
    for k, piece in enumerate(signal.pieces):
        field["piece"][k] = piece.byte, piece.bit, piece.width, piece.signal_bit


def _contract_field(codec: Codec, row: int, signal: Signal, first: int, names: list[str]) -> None:
    codes = {str(text): int(raw) for raw, text in (signal.choices or {}).items()}
    top = (1 << (signal.length - int(signal.is_signed))) - 1
    bottom = -top - 1 if signal.is_signed else 0
    scale, offset = float(signal.scale), float(signal.offset)
    low = bottom if signal.minimum is None else round((float(signal.minimum) - offset) / scale)
    high = top if signal.maximum is None else round((float(signal.maximum) - offset) / scale)
    _place(codec, row, raw_signal(signal))
    field = codec.field[row]
    field["raw_min"], field["raw_max"], field["raw_error"] = low, high, codes.get("Error", top)
    if signal.multiplexer_ids:
        field["page"] = signal.multiplexer_ids[0]
    selector = signal.multiplexer_signal
    field["page_signal"] = first + names.index(selector) if selector else first
    field["scale"], field["offset"] = scale, offset


@cache
def load() -> Codec:
    """Tables of every message of ``roll_control.dbc``, in the file's order."""
    codec = _empty()
    for index, message in enumerate(_messages().values()):
        row = codec.message[index]
        row["ident"] = row["key"] = message.frame_id
        row["length"] = message.length
        row["cycle_ns"] = (message.cycle_time or 0) * MS
        names = [signal.name for signal in message.signals]
        for k, signal in enumerate(message.signals):
            _contract_field(codec, int(row["first"]) + k, signal, int(row["first"]), names)
        e2e.put(codec.protection[index], protection(message, None, (), dbc.PATH.name))
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
            codec.message[free]["contract"] = index
            index, free = free, free + 1
        row = codec.message[index]
        row["key"] = box.ident
        row["ident"], row["length"] = box.ident & (EXTENDED_IDENT - 1), box.sent_length
        row["flags"] = flags_of(box)
        row["cycle_ns"] = round(box.cycle_ms * MS)
        row["leader"] = leaders.setdefault(box.ident, index)
        e2e.put(codec.protection[index], box.protection)
        summed = {signal.place.text for signal in box.signals if signal.added}
        # of a sum the finest last: it has the rest
        for signal in sorted(box.signals, key=lambda its: -its.step):
            if signal.place.text not in names.signals:
                continue
            name = names.signals[signal.place.text]
            first = at = signal_index(names.message, name)
            if codec.field[at]["pieces"]:
                # a mean of several: the same value is in each; a sum: each has a part of it
                last = first
                while codec.field[last]["alike"] >= 0:
                    last = codec.field[last]["alike"]
                codec.field[last]["alike"] = spare
                at, spare = spare, spare + 1
            _place(codec, at, signal)
            codec.field[at]["frame"] = index
            _scale(codec, at, signal, unit(names.message, name))
            if signal.place.text in summed:
                codec.field[at]["parted"] = 1
                while first != at:
                    limits = [int(codec.field[at][name]) for name in ("raw_min", "raw_max")]
                    codec.field[first]["rest"] += sum(physical(codec, at, n) for n in limits) / 2
                    first = int(codec.field[first]["alike"])
            others: dict[str, RawSignal | None] = {
                "minus": signal.minus,
                "twin": signal.twin.signal if signal.twin else None,
                "validity": signal.validity.signal if signal.validity else None,
            }
            for column, other in others.items():
                if other is not None:
                    _place(codec, spare, other)
                    codec.field[at][column] = spare
                    spare += 1
            if signal.validity is not None:
                # what the signals that share it have in common: one code says it of all of them
                codes = valid_codes(box.signals)[signal.validity.signal.name]
                codec.field[at]["valid_code"] = codes[0]
                codec.field[at]["invalid_code"] = _missing(codes)
            if signal.twin is not None:
                codec.field[at]["inverted"] = signal.twin.inverted
                codec.field[at]["tolerance"] = signal.twin.tolerance
        if box.selector is not None:
            _place(codec, spare, box.selector)
            row["selector"], row["selected"] = spare, box.pages[0]
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
        if row["length"] and row["leader"] != leader:
            continue
        candidates = {
            signal.name: rest[signal.name]
            for signal in message.signals
            if signal.name in rest
            and (rest[signal.name].unit or "") == (signal.unit or "")
            and signal.name not in OF_THE_FRAME
        }
        values = {signal.name for signal in message.signals} - OF_THE_FRAME
        if not row["length"] and candidates.keys() == values:
            own = row.copy()
            codec.message[index] = codec.message[leader]
            for name in ("first", "end", "contract"):
                row[name] = own[name]
        if row["length"]:
            names = [signal.name for signal in message.signals]
            for name, signal in candidates.items():
                at, first = signal_index(message.name, name), int(row["first"])
                _contract_field(codec, at, signal, first, names)


def _scale(codec: Codec, row: int, signal: MappedSignal, contract_unit: str) -> None:
    """Scaling in the contract's unit, and the range of valid codes."""
    factor = float(conversion(signal.place.unit, contract_unit, signal.name, dbc.PATH.name))
    factor /= 2**signal.place.q
    field = codec.field[row]
    field["scale"], field["offset"] = float(signal.scale) * factor, float(signal.offset) * factor
    low, high = signal.raw_lo, signal.raw_hi
    while high in signal.unavailable:
        high -= 1
    while low in signal.unavailable:
        low += 1
    error = signal.unavailable[0] if signal.unavailable else NO_ERROR_CODE
    error = float32.NOT_A_NUMBER if signal.real else error
    field["raw_min"], field["raw_max"], field["raw_error"] = low, high, error
    field["real"] = signal.real
