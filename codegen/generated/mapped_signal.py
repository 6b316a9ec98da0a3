"""Mapping of one DBC signal to its field: bits, units, scale, limits, reserved codes."""

import ast
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from cantools.database import Signal

from canroll.errors import CanrollError, UnknownNameError
from codegen.generated.units import conversion
from firmware.state import Ecu
from firmware.subset import Field, fields

UNAVAILABLE = ("error", "not available", "notavailable", "invalid", "sna", "undefined", "fault")
LONGEST_SIGNAL = 30
KEYS = (
    "field",
    "q",
    "field_unit",
    "unit",
    "factor",
    "offset",
    "sign",
    "redundant",
    "inverted",
    "tolerance",
    "unavailable",
)
"""Keys of the table that a map may have for a signal."""


@dataclass(frozen=True, slots=True)
class Place:
    """A field of the ECU's record, or one element or mask of it, that a signal maps to.

    ``text`` is its expression in the firmware; a stored integer n means n / 2**q ``unit``.
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
    """Position of a signal's raw code in the frame."""

    name: str
    pieces: tuple[Piece, ...]
    length: int
    signed: bool


@dataclass(frozen=True, slots=True)
class Twin:
    """A second signal that carries the same code, or with ``inverted`` its complement.

    The codes may differ by ``tolerance``.
    """

    signal: RawSignal
    inverted: bool
    tolerance: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MappedSignal(RawSignal):
    """One signal and its field; a raw n carries ``scale`` * n + ``offset`` field integers.

    ``page`` is the value of the frame's multiplexer at which the signal is present, None: always.
    ``minus`` is a sign bit elsewhere in the frame: where it is 1, the raw code is negated.
    """

    place: Place
    scale: Fraction
    offset: Fraction
    unavailable: tuple[int, ...]
    raw_lo: int
    raw_hi: int
    page: int | None
    minus: RawSignal | None = None
    twin: Twin | None = None

    @property
    def parts(self) -> tuple[RawSignal, ...]:
        """Signals of the frame that carry it: the raw code, its sign bit and its second signal."""
        more = (self.minus, self.twin.signal if self.twin else None)
        return (self, *(signal for signal in more if signal is not None))


def map_signal(
    name: str, entry: str | Mapping[str, Any], known: Mapping[str, Signal], where: str
) -> MappedSignal:
    """Resolve the entry of the signal ``name`` in a map file.

    Args:
        name: name of the signal.
        entry: its field, or a table with one of ``KEYS``.
        known: signals of the frame.
        where: location of the entry, for errors.

    Raises:
        CanrollError: unit, field or width do not match, or a key is invalid.
    """
    signal = _integer(name, known, where)
    table = {"field": entry} if isinstance(entry, str) else entry
    if not isinstance(table, Mapping):
        raise CanrollError(f"{where}: give a field, or a table with one of {', '.join(KEYS)}")
    for key in table:
        if key not in KEYS:
            raise UnknownNameError(f"key in {where}", key, KEYS)
    place = _place(table, where)
    unit = str(table.get("unit", signal.unit or ""))
    to_field = conversion(unit, place.unit, place.text, where) * 2**place.q
    minus, sign = None, table.get("sign", 1)
    if sign == -1:
        to_field = -to_field
    elif isinstance(sign, str):
        minus = _minus(sign, signal, known, where)
        if _fraction(table, "offset", signal.offset, where):
            raise CanrollError(f"{where}: a signal with a sign signal must have the offset 0")
    elif sign != 1:
        raise CanrollError(f"{where}: sign must be 1, -1 or the name of a signal of one bit")
    scale = _fraction(table, "factor", signal.scale, where) * to_field
    if not scale:
        raise CanrollError(f"{where}: the signal's factor is 0: give it in the map")
    unavailable = set(_codes(table, where)) | {
        int(raw)
        for raw, text in (signal.choices or {}).items()
        if str(text).casefold() in UNAVAILABLE
    }
    raw_lo, raw_hi = _raw_limits(signal, where)
    return MappedSignal(
        name=signal.name,
        place=place,
        pieces=_pieces(signal),
        length=signal.length,
        signed=signal.is_signed,
        scale=scale,
        offset=_fraction(table, "offset", signal.offset, where) * to_field,
        unavailable=tuple(sorted(unavailable)),
        raw_lo=-raw_hi if minus else raw_lo,
        raw_hi=raw_hi,
        page=signal.multiplexer_ids[0] if signal.multiplexer_ids else None,
        minus=minus,
        twin=_twin(table, signal, known, where),
    )


def _integer(name: object, known: Mapping[str, Signal], where: str) -> Signal:
    """An integer signal of the frame, of a width the firmware supports."""
    if not isinstance(name, str) or name not in known:
        raise UnknownNameError(f"signal in {where}", str(name), known)
    signal = known[name]
    if signal.is_float:
        raise CanrollError(
            f"{where}: {name} is a floating-point number of {signal.length} bits (SIG_VALTYPE_): "
            "only integers can be mapped"
        )
    if signal.length > LONGEST_SIGNAL:
        raise CanrollError(f"{where}: {name} must be an integer of at most {LONGEST_SIGNAL} bits")
    return signal


def _fraction(table: Mapping[str, Any], key: str, default: float, where: str) -> Fraction:
    """An exact number from the map's decimals, else from the DBC."""
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise CanrollError(f"{where}: {key} must be a number, not {value!r}")
    return Fraction(str(value))


def _codes(table: Mapping[str, Any], where: str) -> Iterator[int]:
    codes = table.get("unavailable", [])
    if not isinstance(codes, list):
        raise CanrollError(f"{where}: unavailable must be a list of raw codes, not {codes!r}")
    for code in codes:
        if not isinstance(code, int) or isinstance(code, bool):
            raise CanrollError(f"{where}: unavailable must hold raw codes, not {code!r}")
        yield code


def _minus(name: str, signal: Signal, known: Mapping[str, Signal], where: str) -> RawSignal:
    """The separate sign bit of an unsigned signal, or None."""
    bit = _integer(name, known, where)
    if bit.length != 1 or bit.name == signal.name:
        raise CanrollError(f"{where}: {bit.name} has {bit.length} bits, a sign must have one")
    if signal.is_signed:
        raise CanrollError(f"{where}: {signal.name} is signed and needs no sign {bit.name}")
    if bit.multiplexer_ids not in (None, [], signal.multiplexer_ids):
        raise CanrollError(f"{where}: {bit.name} is on another page than {signal.name}")
    return raw_signal(bit)


def _twin(
    table: Mapping[str, Any], signal: Signal, known: Mapping[str, Signal], where: str
) -> Twin | None:
    """The second signal that the first is checked against, or None."""
    named = [key for key in ("redundant", "inverted") if key in table]
    if len(named) > 1:
        raise CanrollError(f"{where}: give either redundant or inverted")
    if not named:
        if "tolerance" in table:
            raise CanrollError(f"{where}: tolerance needs redundant or inverted")
        return None
    other = _integer(table[named[0]], known, where)
    alike = ("length", "is_signed", "scale", "offset", "multiplexer_ids")
    for key in alike:
        if getattr(other, key) != getattr(signal, key):
            raise CanrollError(
                f"{where}: {other.name} must have the {key.removeprefix('is_')} of {signal.name}"
            )
    if other.name == signal.name:
        raise CanrollError(f"{where}: {signal.name} cannot be its own {named[0]} signal")
    tolerance = _fraction(table, "tolerance", 0, where)
    step = abs(_fraction(table, "factor", signal.scale, where))
    if tolerance < 0:
        raise CanrollError(f"{where}: tolerance must be at least 0")
    return Twin(raw_signal(other), named[0] == "inverted", math.floor(tolerance / step))


def _raw_limits(signal: Signal, where: str) -> tuple[int, int]:
    """The raw codes that the DBC's minimum and maximum allow."""
    span = 1 << signal.length
    lo, hi = (-span // 2, span // 2 - 1) if signal.is_signed else (0, span - 1)
    if signal.minimum is None or signal.maximum is None or signal.minimum >= signal.maximum:
        return lo, hi
    if not signal.scale:
        return lo, hi
    factor, offset = Fraction(str(signal.scale)), Fraction(str(signal.offset))
    ends = sorted(
        (Fraction(str(limit)) - offset) / factor for limit in (signal.minimum, signal.maximum)
    )
    lo, hi = max(lo, math.ceil(ends[0])), min(hi, math.floor(ends[1]))
    if lo > hi:
        raise CanrollError(f"{where}: no raw code lies within the DBC's minimum and maximum")
    return lo, hi


def _place(table: Mapping[str, Any], where: str) -> Place:
    """Resolve ``field``, ``field[i]`` or ``field & mask``."""
    text = str(table.get("field", ""))
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
    record: dict[str, Field] = {field.name: field for field in fields(Ecu)}
    if node.id not in record:
        raise UnknownNameError(f"field in {where}", node.id, record)
    field = record[node.id]
    if (index is None) != (field.shape == ()) or len(field.shape) > 1:
        raise CanrollError(f"{where}: {field.name} has shape {field.shape}")
    if index is not None and not 0 <= index < field.shape[0]:
        raise CanrollError(f"{where}: {field.name} has {field.shape[0]} elements")
    given = [key for key in ("q", "field_unit") if key in table]
    if given and (field.f.q or field.f.unit):
        raise CanrollError(f"{where}: {given[0]} of {field.name} is fixed: omit it")
    if not isinstance(table.get("q", 0), int):
        raise CanrollError(f"{where}: q must be a whole number, not {table['q']!r}")
    return Place(
        text=node.id if index is None else f"{node.id}[{index}]",
        mask=mask,
        lo=field.f.lo if mask is None else 0,
        hi=field.f.hi if mask is None else mask,
        q=int(table.get("q", field.f.q)),
        unit=str(table.get("field_unit", field.f.unit)),
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
    """Bits of the frame that a signal occupies, least significant first; 8 k + b for bit b of k."""
    if signal.byte_order == "little_endian":
        return [signal.start + i for i in range(signal.length)]
    byte, bit = divmod(signal.start, 8)
    first = byte * 8 + 7 - bit
    places = [divmod(first + i, 8) for i in reversed(range(signal.length))]
    return [8 * byte + 7 - bit for byte, bit in places]


def _pieces(signal: Signal) -> tuple[Piece, ...]:
    """Split a signal at byte boundaries, its least significant bit first."""
    pieces: list[Piece] = []
    for i, place in enumerate(bits_of(signal)):
        byte, bit = divmod(place, 8)
        last = pieces[-1] if pieces else None
        if last is not None and last.byte == byte:
            pieces[-1] = Piece(byte, last.bit, last.width + 1, last.signal_bit)
        else:
            pieces.append(Piece(byte, bit, 1, i))
    return tuple(pieces)
