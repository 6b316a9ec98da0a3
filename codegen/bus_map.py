"""Which signal of a DBC is which field of the ECU's record, and how the one becomes the other.

A map file (TOML, see ``dbc/roll_control.toml``) names for each mailbox of the firmware the frame
in it and for each signal the field. Units meet here: a DBC may say deg/s or km/h, the fields are
SI. :func:`load` resolves a DBC and its map into :class:`Mailbox` tables, or says which key of
which file is wrong.
"""

import ast
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import cantools
from cantools.database import Database, Message, Signal

from canroll.errors import CanrollError, UnknownNameError
from firmware.state import Ecu
from firmware.subset import Field, fields

RECEIVED = (
    "imu",
    "vehicle_motion",
    "suspension_rate",
    "actuator_state",
    "roll_reference",
)
TRANSMITTED = ("suspension_force", "anti_roll_bar", "damper", "valve", "status", "diagnostics")
SAMPLE_COUNTERS = {
    "imu": "imu_sample",
    "vehicle_motion": "motion_sample",
    "suspension_rate": "rate_sample",
    "actuator_state": "actuator_sample",
    "roll_reference": "reference_sample",
}
# The order is that of the bits of ecu.valid: the firmware asks for them by number.
VALID_BITS = {
    "imu": ("roll_rate", "lateral_acceleration", "yaw_rate"),
    "vehicle_motion": ("speed", "steering"),
    "suspension_rate": tuple(f"stroke_rate[{corner}]" for corner in range(4)),
    "actuator_state": ("delivered[0]", "delivered[1]"),
    "roll_reference": ("reference_roll", "reference_rate", "reference_acceleration"),
}
UNAVAILABLE = ("error", "not available", "notavailable", "invalid", "sna", "undefined", "fault")
EXTENDED = 1 << 30
LONGEST_SIGNAL = 30

_DEGREE = Fraction(math.pi) / 180
_G = Fraction(980665, 100000)
UNITS: dict[str, tuple[str, Fraction]] = {
    "": ("", Fraction(1)),
    "rad": ("angle", Fraction(1)),
    "deg": ("angle", _DEGREE),
    "°": ("angle", _DEGREE),
    "rad/s": ("rate", Fraction(1)),
    "deg/s": ("rate", _DEGREE),
    "°/s": ("rate", _DEGREE),
    "m": ("length", Fraction(1)),
    "mm": ("length", Fraction(1, 1000)),
    "m/s": ("speed", Fraction(1)),
    "mm/s": ("speed", Fraction(1, 1000)),
    "km/h": ("speed", Fraction(10, 36)),
    "mph": ("speed", Fraction(44704, 100000)),
    "m/s2": ("acceleration", Fraction(1)),
    "m/s²": ("acceleration", Fraction(1)),
    "m/s^2": ("acceleration", Fraction(1)),
    "g": ("acceleration", _G),
    "N": ("force", Fraction(1)),
    "kN": ("force", Fraction(1000)),
    "Nm": ("moment", Fraction(1)),
    "N·m": ("moment", Fraction(1)),
    "N.m": ("moment", Fraction(1)),
    "kNm": ("moment", Fraction(1000)),
    "mA": ("current", Fraction(1)),
    "A": ("current", Fraction(1000)),
}


@dataclass(frozen=True, slots=True)
class Place:
    """A field of the ECU's record, or one element of it, as one signal sees it.

    ``text`` is what the firmware calls it; a stored integer n stands for n / 2**q ``unit``.
    """

    text: str
    mask: int | None
    lo: int
    hi: int
    q: int
    unit: str


@dataclass(frozen=True, slots=True)
class Piece:
    """``width`` bits of a signal from ``signal_bit`` up, in ``byte`` from ``bit`` up."""

    byte: int
    bit: int
    width: int
    signal_bit: int


@dataclass(frozen=True, slots=True)
class MappedSignal:
    """One signal and its field; a raw n carries ``scale`` * n + ``offset`` field integers."""

    name: str
    place: Place
    pieces: tuple[Piece, ...]
    length: int
    signed: bool
    scale: Fraction
    offset: Fraction
    unavailable: tuple[int, ...]
    raw_lo: int
    raw_hi: int
    page: int | None


@dataclass(frozen=True, slots=True)
class Mailbox:
    """One mailbox of the firmware and the frame in it; ``name`` "" means that it stays empty."""

    slot: str
    name: str
    comment: str
    ident: int
    length: int
    data_id: int
    signals: tuple[MappedSignal, ...]


@dataclass(frozen=True, slots=True)
class BusMap:
    """All mailboxes, in the order of the firmware's slot numbers."""

    received: tuple[Mailbox, ...]
    transmitted: tuple[Mailbox, ...]


def load(dbc: Path, map_file: Path) -> BusMap:
    """Return the mailboxes that ``dbc`` and ``map_file`` describe.

    Raises CanrollError, naming file and key, for whatever doesn't fit together.
    """
    try:
        database = cantools.database.load_file(dbc)
    except (OSError, cantools.database.UnsupportedDatabaseFormatError) as error:
        raise CanrollError(f"{dbc}: not a readable DBC: {error}") from error
    if not isinstance(database, Database):
        raise CanrollError(f"{dbc}: not a CAN database; give a .dbc file")
    try:
        document = tomllib.loads(map_file.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise CanrollError(f"{map_file}: {error}") from error
    if document.get("schema") != 1:
        raise CanrollError(f"{map_file}: schema must be 1, not {document.get('schema')!r}")
    for key in document:
        if key not in ("schema", "receive", "transmit"):
            raise UnknownNameError(f"table in {map_file}", key, ("receive", "transmit"))
    boxes = {}
    for direction, slots in (("receive", RECEIVED), ("transmit", TRANSMITTED)):
        tables = document.get(direction, {})
        for slot in tables:
            if slot not in slots:
                raise UnknownNameError(f"mailbox [{direction}.…] in {map_file}", slot, slots)
        boxes[direction] = tuple(
            _mailbox(database, map_file, direction, slot, tables.get(slot)) for slot in slots
        )
    return BusMap(boxes["receive"], boxes["transmit"])


def _mailbox(
    database: Database, map_file: Path, direction: str, slot: str, table: Mapping[str, Any] | None
) -> Mailbox:
    where = f"{map_file} [{direction}.{slot}]"
    if table is None:
        return Mailbox(slot, "", "", 0, 0, 0, ())
    messages = {message.name: message for message in database.messages}
    name = table.get("message", "")
    if name not in messages:
        raise UnknownNameError(f"message in {where}", name, messages)
    message = messages[name]
    if message.length > 8:
        raise CanrollError(f"{where}: {name} has {message.length} bytes; the mailbox holds 8")
    known = {signal.name: signal for signal in message.signals}
    mapped = []
    for signal_name, entry in table.get("signals", {}).items():
        if signal_name not in known:
            raise UnknownNameError(f"signal of {name} in {where}", signal_name, known)
        mapped.append(_signal(known[signal_name], entry, f"{where} {signal_name}"))
    if direction == "receive":
        taken = {signal.place.text for signal in mapped}
        if slot != "roll_reference" and not taken & set(VALID_BITS[slot]):
            raise CanrollError(f"{where}: maps none of {', '.join(VALID_BITS[slot])}")
        if any(signal.place.mask is not None for signal in mapped):
            raise CanrollError(f"{where}: a mask makes sense only in a transmitted frame")
    ident = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
    return Mailbox(
        slot=slot,
        name=name,
        comment=message.comment or "",
        ident=ident,
        length=message.length,
        data_id=_data_id(message),
        signals=tuple(sorted(mapped, key=lambda signal: signal.page or 0)),
    )


def _data_id(message: Message) -> int:
    attribute = message.dbc.attributes.get("E2EDataId") if message.dbc else None
    return int(attribute.value) if attribute else 0


def _signal(signal: Signal, entry: str | Mapping[str, Any], where: str) -> MappedSignal:
    if signal.is_float or signal.length > LONGEST_SIGNAL:
        raise CanrollError(f"{where}: an integer of at most {LONGEST_SIGNAL} bits is needed")
    place = _place(entry, where)
    unit = signal.unit or ""
    if unit not in UNITS or place.unit not in UNITS:
        unknown = unit if unit not in UNITS else place.unit
        raise UnknownNameError(f"unit in {where}", unknown, UNITS)
    (quantity, factor), (expected, _) = UNITS[unit], UNITS[place.unit]
    if quantity != expected:
        raise CanrollError(f"{where}: unit '{unit}' is no unit of {place.text} ('{place.unit}')")
    to_field = factor / UNITS[place.unit][1] * 2**place.q
    scale = Fraction(str(signal.scale)) * to_field
    if not scale:
        raise CanrollError(f"{where}: the signal's factor is 0")
    span = 1 << signal.length
    raw_range = (-span // 2, span // 2 - 1) if signal.is_signed else (0, span - 1)
    choices = signal.choices or {}
    named = entry.get("unavailable", ()) if isinstance(entry, Mapping) else ()
    unavailable = set(named) | {
        int(raw) for raw, text in choices.items() if str(text).casefold() in UNAVAILABLE
    }
    raw_lo, raw_hi = _raw_limits(signal, raw_range, where)
    return MappedSignal(
        name=signal.name,
        place=place,
        pieces=_pieces(signal),
        length=signal.length,
        signed=signal.is_signed,
        scale=scale,
        offset=Fraction(str(signal.offset)) * to_field,
        unavailable=tuple(sorted(unavailable)),
        raw_lo=raw_lo,
        raw_hi=raw_hi,
        page=signal.multiplexer_ids[0] if signal.multiplexer_ids else None,
    )


def _raw_limits(signal: Signal, raw_range: tuple[int, int], where: str) -> tuple[int, int]:
    """The raw codes that the DBC's minimum and maximum allow."""
    lo, hi = raw_range
    if signal.minimum is None or signal.maximum is None or signal.minimum >= signal.maximum:
        return lo, hi
    factor, offset = Fraction(str(signal.scale)), Fraction(str(signal.offset))
    ends = sorted(
        (Fraction(str(limit)) - offset) / factor for limit in (signal.minimum, signal.maximum)
    )
    lo, hi = max(lo, math.ceil(ends[0])), min(hi, math.floor(ends[1]))
    if lo > hi:
        raise CanrollError(f"{where}: no raw code lies within the DBC's minimum and maximum")
    return lo, hi


def _place(entry: str | Mapping[str, Any], where: str) -> Place:
    """Resolve ``field``, ``field[i]`` or ``field & mask``."""
    text = entry if isinstance(entry, str) else str(entry.get("field", ""))
    mask = None
    try:
        node: ast.expr = ast.parse(text, mode="eval").body
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd):
            mask = int(ast.literal_eval(node.right))
            node = node.left
        index = None
        if isinstance(node, ast.Subscript):
            index = int(ast.literal_eval(node.slice))
            node = node.value
        if not isinstance(node, ast.Name):
            raise ValueError(text)
    except (SyntaxError, ValueError, TypeError) as error:
        raise CanrollError(
            f"{where}: '{text}' must read field, field[i] or field & mask"
        ) from error
    table: dict[str, Field] = {field.name: field for field in fields(Ecu)}
    if node.id not in table:
        raise UnknownNameError(f"field in {where}", node.id, table)
    field = table[node.id]
    if (index is None) != (field.shape == ()) or len(field.shape) > 1:
        raise CanrollError(f"{where}: {field.name} has shape {field.shape}")
    if index is not None and not 0 <= index < field.shape[0]:
        raise CanrollError(f"{where}: {field.name} has {field.shape[0]} elements")
    options: Mapping[str, Any] = {} if isinstance(entry, str) else entry
    return Place(
        text=node.id if index is None else f"{node.id}[{index}]",
        mask=mask,
        lo=field.f.lo if mask is None else 0,
        hi=field.f.hi if mask is None else mask,
        q=int(options.get("q", field.f.q)),
        unit=str(options.get("unit", field.f.unit)),
    )


def _pieces(signal: Signal) -> tuple[Piece, ...]:
    """Cut a signal where bytes end, its least significant bit first."""
    if signal.byte_order == "little_endian":
        positions = [divmod(signal.start + i, 8) for i in range(signal.length)]
    else:
        byte, bit = divmod(signal.start, 8)
        first = byte * 8 + 7 - bit
        positions = [
            ((first + i) // 8, 7 - (first + i) % 8) for i in reversed(range(signal.length))
        ]
    pieces: list[Piece] = []
    for i, (byte, bit) in enumerate(positions):
        last = pieces[-1] if pieces else None
        if last is not None and last.byte == byte:
            pieces[-1] = Piece(byte, last.bit, last.width + 1, last.signal_bit)
        else:
            pieces.append(Piece(byte, bit, 1, i))
    return tuple(pieces)
