"""Signals of a frame that belong to another one: its sign, its second code, its validity."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from cantools.database import Signal

from canroll.codegen.frame.raw_signal import (
    RawSignal,
    code_range,
    fraction,
    integer_signal,
    raw_signal,
)
from canroll.errors import CanrollError


@dataclass(frozen=True, slots=True)
class Twin:
    """A second signal that carries the same code, or with ``inverted`` its complement.

    The codes may differ by ``tolerance``.
    """

    signal: RawSignal
    inverted: bool
    tolerance: int


@dataclass(frozen=True, slots=True)
class Validity:
    """A signal of the frame that tells by its raw code, one of ``codes``, that another is valid."""

    signal: RawSignal
    codes: tuple[int, ...]


def valid_codes(signals: Iterable[Any]) -> dict[str, tuple[int, ...]]:
    """Return the codes of each validity signal by which all signals that share it are valid.

    Args:
        signals: mapped signals of a frame.
    """
    common: dict[str, set[int]] = {}
    for signal in signals:
        if signal.validity is not None:
            name, codes = signal.validity.signal.name, set(signal.validity.codes)
            common[name] = common.get(name, codes) & codes
    return {name: tuple(sorted(codes)) for name, codes in common.items()}


def minus_of(name: str, signal: Signal, known: Mapping[str, Signal], where: str) -> RawSignal:
    """The separate sign bit of an unsigned signal, or None."""
    bit = integer_signal(name, known, where)
    if bit.length != 1 or bit.name == signal.name:
        raise CanrollError(f"{where}: {bit.name} has {bit.length} bits, a sign must have one")
    if signal.is_signed:
        raise CanrollError(f"{where}: {signal.name} is signed and needs no sign {bit.name}")
    if bit.multiplexer_ids not in (None, [], signal.multiplexer_ids):
        raise CanrollError(f"{where}: {bit.name} is on another page than {signal.name}")
    return raw_signal(bit)


def twin_of(
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
    other = integer_signal(table[named[0]], known, where)
    alike = ("length", "is_signed", "scale", "offset", "multiplexer_ids")
    for key in alike:
        if getattr(other, key) != getattr(signal, key):
            raise CanrollError(
                f"{where}: {other.name} must have the {key.removeprefix('is_')} of {signal.name}"
            )
    if other.name == signal.name:
        raise CanrollError(f"{where}: {signal.name} cannot be its own {named[0]} signal")
    tolerance = fraction(table, "tolerance", 0, where)
    step = abs(fraction(table, "factor", signal.scale, where))
    if tolerance < 0:
        raise CanrollError(f"{where}: tolerance must be at least 0")
    return Twin(raw_signal(other), named[0] == "inverted", math.floor(tolerance / step))


def validity_of(
    table: Mapping[str, Any], signal: Signal, known: Mapping[str, Signal], where: str
) -> Validity | None:
    """The signal that tells whether this one is valid, or None."""
    if "valid" not in table:
        return None
    entry = table["valid"]
    given = {"signal": entry, "codes": [1]} if isinstance(entry, str) else entry
    if not isinstance(given, Mapping) or given.keys() != {"signal", "codes"}:
        raise CanrollError(
            f"{where}: valid must be the name of a signal that is 1 where this one is valid, or "
            "a table with signal and codes"
        )
    other = integer_signal(given["signal"], known, where)
    codes = given["codes"]
    lo, hi = code_range(other)
    if not isinstance(codes, list) or not codes:
        raise CanrollError(f"{where}: codes of valid must be a list of raw codes, not {codes!r}")
    for code in codes:
        if not isinstance(code, int) or isinstance(code, bool) or not lo <= code <= hi:
            raise CanrollError(
                f"{where}: codes of valid must be whole numbers {lo} to {hi}, which "
                f"{other.name} can be, not {code!r}"
            )
    if len(set(codes)) > hi - lo:
        raise CanrollError(f"{where}: every code of {other.name} is valid: omit valid")
    if other.name == signal.name:
        raise CanrollError(f"{where}: codes of itself that carry no value are unavailable")
    if other.multiplexer_ids not in (None, [], signal.multiplexer_ids):
        raise CanrollError(f"{where}: {other.name} is on another page than {signal.name}")
    return Validity(raw_signal(other), tuple(sorted(set(codes))))
