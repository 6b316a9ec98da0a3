"""Mapping of one DBC signal to its field: bits, units, scale, limits, reserved codes."""

import ast
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from cantools.database import Signal

from canroll import documents
from canroll.codegen.frame.raw_signal import (
    RawSignal,
    code_of,
    code_range,
    fraction,
    number_signal,
    pieces_of,
    real_of,
)
from canroll.codegen.frame.units import conversion
from canroll.codegen.generated.second_signals import Twin, Validity, minus_of, twin_of, validity_of
from canroll.errors import CanrollError, UnknownNameError
from canroll.firmware.state import Ecu
from canroll.firmware.subset import Field, fields

UNAVAILABLE = ("error", "not available", "notavailable", "invalid", "sna", "undefined", "fault")
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
    "valid",
    "radius",
    "add",
)
"""Keys of the table that a map may have for a signal."""
OF_INTEGERS = ("redundant", "inverted", "tolerance", "unavailable")
"""Keys of signals that are no floating-point numbers."""
LARGEST_REAL = 0x7F7FFFFF
"""The bits of the largest number of 32 bits."""


@dataclass(frozen=True, slots=True)
class SignalPlace:
    """A field of the ECU's record, or one element or mask of it, that a signal maps to.

    ``text`` is its expression in the firmware; a stored integer n means n / 2**q ``unit``.
    """

    text: str
    mask: int | None
    lo: int
    hi: int
    q: int
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class MappedSignal(RawSignal):
    """One signal and its field; a raw n carries ``scale`` * n + ``offset`` field integers.

    Where it is ``real``, n is the number of which the raw code is the bits; ``offset`` is 0.
    ``page`` is the value of the frame's multiplexer at which the signal is present, None: always.
    ``minus`` is a sign bit elsewhere in the frame: where it is 1, the raw code is negated.
    ``step`` is ``scale`` without sign, of a wheel without its radius. ``added``: the field is the
    sum of this signal and another one. ``warning`` names limits that are not kept, "" if none.
    """

    place: SignalPlace
    scale: Fraction
    offset: Fraction
    unavailable: tuple[int, ...]
    raw_lo: int
    raw_hi: int
    page: int | None
    step: Fraction
    added: bool
    warning: str
    minus: RawSignal | None = None
    twin: Twin | None = None
    validity: Validity | None = None

    @property
    def parts(self) -> tuple[RawSignal, ...]:
        """Signals of the frame that carry it: raw code, sign bit, second signal, validity."""
        more = (
            self.minus,
            self.twin.signal if self.twin else None,
            self.validity.signal if self.validity else None,
        )
        return (self, *(signal for signal in more if signal is not None))


def map_signal(
    name: str,
    entry: str | Mapping[str, Any],
    known: Mapping[str, Signal],
    where: str,
    *,
    sent: bool = False,
) -> MappedSignal:
    """Resolve the entry of the signal ``name`` in a map file.

    Args:
        name: name of the signal.
        entry: its field, or a table with one of ``KEYS``.
        known: signals of the frame.
        where: location of the entry, for errors.
        sent: the ECU sends the signal, so that any limit of the DBC is kept.

    Raises:
        CanrollError: unit, field or width do not match, or a key is invalid.
    """
    signal = number_signal(name, known, where)
    table = {"field": entry} if isinstance(entry, str) else entry
    if not isinstance(table, Mapping):
        raise CanrollError(f"{where}: give a field, or a table with one of {', '.join(KEYS)}")
    documents.refuse_unknown(table, KEYS, f"key in {where}")
    place = _place(table, where)
    radius = _radius(table, place, where)
    unit = "rad/s" if "radius" in table else place.unit
    own_unit = str(table.get("unit", signal.unit or ""))
    to_field = conversion(own_unit, unit, place.text, where) * 2**place.q
    minus, sign = None, table.get("sign", 1)
    if sign == -1:
        to_field = -to_field
    elif isinstance(sign, str):
        minus = minus_of(sign, signal, known, where)
        if fraction(table, "offset", signal.offset, where):
            raise CanrollError(f"{where}: a signal with a sign signal must have the offset 0")
    elif sign != 1:
        raise CanrollError(f"{where}: sign must be 1, -1 or the name of a signal of one bit")
    step = fraction(table, "factor", signal.scale, where) * to_field
    to_field *= radius
    scale = step * radius
    if not scale:
        raise CanrollError(f"{where}: the signal's factor is 0: give it in the map")
    if signal.is_float:
        _refuse_of_integers(table, signal, scale, where)
    unavailable = set(_codes(table, where)) | {
        int(raw)
        for raw, text in (signal.choices or {}).items()
        if str(text).casefold() in UNAVAILABLE
    }
    if not isinstance(table.get("add", False), bool):
        raise CanrollError(f"{where}: add must be true or false, not {table['add']!r}")
    limits = _limits(signal)
    warning = "" if sent else _one_sided(signal, limits, place, where)
    raw_lo, raw_hi = _raw_limits(signal, () if warning else limits, where, sent=sent)
    return MappedSignal(
        name=signal.name,
        place=place,
        pieces=pieces_of(signal),
        length=signal.length,
        signed=signal.is_signed or signal.is_float,
        real=signal.is_float,
        scale=scale,
        offset=fraction(table, "offset", signal.offset, where) * to_field,
        unavailable=tuple(sorted(unavailable)),
        raw_lo=-raw_hi if minus else raw_lo,
        raw_hi=raw_hi,
        page=signal.multiplexer_ids[0] if signal.multiplexer_ids else None,
        step=abs(step),
        added=table.get("add") is True,
        warning=warning,
        minus=minus,
        twin=twin_of(table, signal, known, where),
        validity=validity_of(table, signal, known, where),
    )


def _radius(table: Mapping[str, Any], place: SignalPlace, where: str) -> Fraction:
    """The radius of the wheel whose angular speed the signal is, 1 where it is of no wheel."""
    radius = fraction(table, "radius", 1, where)
    if radius <= 0 or ("radius" in table and place.text != "speed"):
        raise CanrollError(
            f"{where}: radius must be above 0 m, and belongs to the speed of a wheel"
        )
    return radius


def _refuse_of_integers(
    table: Mapping[str, Any], signal: Signal, scale: Fraction, where: str
) -> None:
    """Raise CanrollError for what a floating-point signal cannot have."""
    keys = [key for key in OF_INTEGERS if key in table]
    keys += ["sign signal"] if isinstance(table.get("sign"), str) else []
    if signal.choices and any(str(t).casefold() in UNAVAILABLE for t in signal.choices.values()):
        keys.append("code for not available (VAL_)")
    if fraction(table, "offset", signal.offset, where):
        keys.append("offset")
    if keys:
        raise CanrollError(
            f"{where}: {signal.name} is a floating-point number, which can have no {keys[0]}"
        )
    if not -60 <= math.log2(abs(scale)) <= 60:
        raise CanrollError(f"{where}: the factor of {signal.name} is out of range: correct it")


def _codes(table: Mapping[str, Any], where: str) -> Iterator[int]:
    codes = table.get("unavailable", [])
    if not isinstance(codes, list):
        raise CanrollError(f"{where}: unavailable must be a list of raw codes, not {codes!r}")
    for code in codes:
        if not isinstance(code, int) or isinstance(code, bool):
            raise CanrollError(f"{where}: unavailable must hold raw codes, not {code!r}")
        yield code


def refuse_received_only(mapped: Sequence[MappedSignal], where: str) -> None:
    """Raise CanrollError for what a received frame cannot have: a mask, a mean of unlike signals.

    Offsets may differ: each of them still carries the quantity as a whole.
    """
    by_field: dict[str, list[MappedSignal]] = {}
    for signal in mapped:
        if signal.place.mask is not None:
            raise CanrollError(f"{where}: a mask applies to transmitted frames only")
        by_field.setdefault(signal.place.text, []).append(signal)
    for text, (first, *others) in by_field.items():
        added = [signal.name for signal in (first, *others) if signal.added]
        if added and len(added) != len(others):
            raise CanrollError(
                f"{where}: {added[0]} is added to one signal of {text} without add, not to "
                f"{1 + len(others) - len(added)}"
            )
        for other in others:
            both = f"{where}: {first.name} and {other.name} are both mapped to {text}"
            if (
                not first.place.unit
                or any(its.minus or its.twin or its.real for its in (first, other))
                or first.page != other.page
            ):
                raise CanrollError(
                    f"{both}; only plain signals of integers with a unit, on one page, are "
                    "averaged or added"
                )
            if not added and _likeness(first) != _likeness(other):
                raise CanrollError(
                    f"{both} with different factors or ranges: give add = true to the one that "
                    "is to be added, or map one of them"
                )


def _likeness(signal: MappedSignal) -> tuple[Fraction, int]:
    """The step, and the number of steps in the range: of signals that are averaged the same."""
    return signal.step, signal.raw_hi - signal.raw_lo


def refuse_sent_only(mapped: Sequence[MappedSignal], where: str) -> None:
    """Raise CanrollError for what a frame that is sent cannot have."""
    for signal in mapped:
        for key, given in (("valid", signal.validity is not None), ("add", signal.added)):
            if given:
                raise CanrollError(
                    f"{where}: {signal.name}: {key} applies to received signals only"
                )


def _limits(signal: Signal) -> list[Fraction]:
    """The DBC's minimum and maximum as raw codes, the lower one first; [] where it has none."""
    lo, hi = signal.minimum, signal.maximum
    if lo is None or hi is None or lo >= hi or not signal.scale:
        return []
    factor, offset = Fraction(str(signal.scale)), Fraction(str(signal.offset))
    return sorted((Fraction(str(limit)) - offset) / factor for limit in (lo, hi))


def _one_sided(signal: Signal, ends: Sequence[Fraction], place: SignalPlace, where: str) -> str:
    """Why limits are not kept that leave a signed signal only one side of zero, "" if they do not.

    They are those of an unsigned signal, or of its absolute value.
    """
    signed = (signal.is_signed or signal.is_float) and place.lo < 0
    if not ends or not signed or ends[0] < 0 < ends[1]:
        return ""
    limits = f"[{signal.minimum:g}|{signal.maximum:g}]"
    return f"{where} is signed: its limits {limits} in the description are not kept"


def _raw_limits(
    signal: Signal, ends: Sequence[Fraction], where: str, *, sent: bool
) -> tuple[int, int]:
    """The raw codes that limits allow, all without any.

    Of a received signal, limits that no code can reach were meant otherwise, as of raw codes or of
    another width; a sent one keeps whichever can be.
    """
    lo, hi = code_range(signal)
    if signal.is_float:
        lo, hi = code_of(-real_of(LARGEST_REAL)), LARGEST_REAL
    if not ends:
        return lo, hi
    if signal.is_float:
        top = Fraction(real_of(LARGEST_REAL))
        low, high = (code_of(float(min(max(end, -top), top))) for end in ends)
        return low, high
    if not sent and (ends[0] < lo - 1 or ends[1] > hi + 1):
        return lo, hi
    lo, hi = max(lo, math.ceil(ends[0])), min(hi, math.floor(ends[1]))
    if lo > hi:
        raise CanrollError(f"{where}: no raw code lies within the DBC's minimum and maximum")
    return lo, hi


def _place(table: Mapping[str, Any], where: str) -> SignalPlace:
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
    return SignalPlace(
        text=node.id if index is None else f"{node.id}[{index}]",
        mask=mask,
        lo=field.f.lo if mask is None else 0,
        hi=field.f.hi if mask is None else mask,
        q=int(table.get("q", field.f.q)),
        unit=str(table.get("field_unit", field.f.unit)),
    )
