"""One signal of a DBC and the field it is: bits, units, scale, limits, reserved codes."""

import ast
import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from cantools.database import Signal

from canroll.errors import CanrollError, UnknownNameError
from firmware.state import Ecu
from firmware.subset import Field, fields

UNAVAILABLE = ("error", "not available", "notavailable", "invalid", "sna", "undefined", "fault")
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


@dataclass(frozen=True, slots=True, kw_only=True)
class RawSignal:
    """Where a signal's raw code stands in the frame."""

    name: str
    pieces: tuple[Piece, ...]
    length: int
    signed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class MappedSignal(RawSignal):
    """One signal and its field; a raw n carries ``scale`` * n + ``offset`` field integers.

    ``page`` is the value of the frame's multiplexer at which the signal is there, None: always.
    """

    place: Place
    scale: Fraction
    offset: Fraction
    unavailable: tuple[int, ...]
    raw_lo: int
    raw_hi: int
    page: int | None


def map_signal(signal: Signal, entry: str | Mapping[str, Any], where: str) -> MappedSignal:
    """Resolve one entry of a map file; ``where`` is what an error says of its place.

    Raises CanrollError where unit, field or width don't fit.
    """
    if signal.is_float or signal.length > LONGEST_SIGNAL:
        raise CanrollError(f"{where}: an integer of at most {LONGEST_SIGNAL} bits is needed")
    place = _place(entry, where)
    unit = signal.unit or ""
    if unit not in UNITS or place.unit not in UNITS:
        unknown = unit if unit not in UNITS else place.unit
        raise UnknownNameError(f"unit in {where}", unknown, UNITS)
    (quantity, factor), (expected, _) = UNITS[unit], UNITS[place.unit]
    if quantity != expected:
        raise CanrollError(f"{where}: unit '{unit}' does not match {place.text} ('{place.unit}')")
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


def raw_signal(signal: Signal) -> RawSignal:
    """A signal's raw code alone."""
    return RawSignal(
        name=signal.name,
        pieces=_pieces(signal),
        length=signal.length,
        signed=signal.is_signed,
    )


def bits_of(signal: Signal) -> list[int]:
    """Bits of the frame that a signal takes, its least significant first; 8 k + b of byte k."""
    if signal.byte_order == "little_endian":
        return [signal.start + i for i in range(signal.length)]
    byte, bit = divmod(signal.start, 8)
    first = byte * 8 + 7 - bit
    places = [divmod(first + i, 8) for i in reversed(range(signal.length))]
    return [8 * byte + 7 - bit for byte, bit in places]


def _pieces(signal: Signal) -> tuple[Piece, ...]:
    """Cut a signal where bytes end, its least significant bit first."""
    pieces: list[Piece] = []
    for i, place in enumerate(bits_of(signal)):
        byte, bit = divmod(place, 8)
        last = pieces[-1] if pieces else None
        if last is not None and last.byte == byte:
            pieces[-1] = Piece(byte, last.bit, last.width + 1, last.signal_bit)
        else:
            pieces.append(Piece(byte, bit, 1, i))
    return tuple(pieces)
