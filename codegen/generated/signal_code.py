"""Expressions of the subset for one signal: raw code from a frame, field from raw code, and back.

A frame is 64-bit words, byte 0 lowest in the first; the top bit of each is its sign. A classic
frame is one word. One integer multiply and one rounding shift turn a raw code into a field's format
and back; the factor is exact to 2**-29. Floating-point numbers:
:mod:`canroll.firmware.com.float32`.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor

from canroll.codegen.frame.raw_signal import REAL_BITS, RawSignal, real_of
from canroll.codegen.generated.mapped_signal import MappedSignal

FACTOR_BITS = 30
LINE = 100
WORD_BITS = 64
LARGEST_SHIFT = 62
INFINITE = 0x7F800000
"""The exponent of infinities and of what is not a number."""


@dataclass(frozen=True, slots=True)
class BitRun:
    """``width`` bits that are contiguous both in one word of the frame and in the signal."""

    word: int
    word_bit: int
    signal_bit: int
    width: int


def runs(signal: RawSignal) -> list[BitRun]:
    """The runs of a signal; one, unless it is of big-endian byte order or in two words."""
    found: list[BitRun] = []
    for piece in sorted(signal.pieces, key=lambda piece: piece.signal_bit):
        word, bit = divmod(8 * piece.byte + piece.bit, WORD_BITS)
        last = found[-1] if found else None
        if last is not None and (last.word, last.word_bit + last.width) == (word, bit):
            found[-1] = BitRun(word, last.word_bit, last.signal_bit, last.width + piece.width)
        else:
            found.append(BitRun(word, bit, piece.signal_bit, piece.width))
    return found


def words(signals: Iterable[RawSignal]) -> list[int]:
    """The words of a frame that contain parts of ``signals``, ascending."""
    return sorted({run.word for signal in signals for run in runs(signal)})


def raw_name(signal: RawSignal) -> str:
    """The local that holds a signal's raw code."""
    return local_name(signal.name)


def local_name(name: str) -> str:
    """The local for a signal's name; none is a word of C, or ends as a type does in POSIX."""
    text = f"raw_{snake(name)}"
    return f"{text}_" if text.endswith("_t") else text


def gathered(signal: RawSignal, frame: Sequence[str]) -> str:
    """The raw code from the words of ``frame``; sign extension is by offset, without a branch."""
    terms = []
    for run in runs(signal):
        term = _shifted(frame[run.word], ">>", run.word_bit)
        term = f"({term})" if run.word_bit else term
        term = f"{term} & {(1 << run.width) - 1}"
        terms.append(f"(({term}) << {run.signal_bit})" if run.signal_bit else f"({term})")
    text = " | ".join(terms)
    if not signal.signed:
        return text[1:-1] if len(terms) == 1 else text
    half = 1 << (signal.length - 1)
    return f"({text if len(terms) == 1 else f'({text})'} ^ {half}) - {half}"


def placed(signal: RawSignal, frame: Sequence[str]) -> Iterator[str]:
    """The statements that insert a signal's raw code into the words of ``frame``."""
    text = raw_name(signal)
    for run in runs(signal):
        term = f"({text} >> {run.signal_bit})" if run.signal_bit else text
        term = f"({term} & {(1 << run.width) - 1})"
        if run.word_bit + run.width == WORD_BITS:
            half = 1 << (run.width - 1)
            term = f"(({term} ^ {half}) - {half})"
        elif run.width == REAL_BITS:
            term = f"to_u32({text})"
        yield f"{frame[run.word]} |= {_shifted(term, '<<', run.word_bit)}"


def chosen(signal: RawSignal, payload: str) -> str:
    """The raw code of an unsigned signal from the bytes of ``payload``."""
    terms = []
    for piece in signal.pieces:
        term = f"{payload}[{piece.byte}]"
        term = f"({term} >> {piece.bit})" if piece.bit else term
        term = f"({term} & {(1 << piece.width) - 1})"
        terms.append(f"({term} << {piece.signal_bit})" if piece.signal_bit else term)
    return " | ".join(terms)


def _shifted(term: str, operator: str, count: int) -> str:
    """A shift by ``count``, in two steps where it exceeds the subset's largest count."""
    if count > LARGEST_SHIFT:
        return f"({term} {operator} {LARGEST_SHIFT}) {operator} {count - LARGEST_SHIFT}"
    return f"{term} {operator} {count}" if count else term


def disagreement(signal: MappedSignal, frame: Sequence[str]) -> Iterator[str]:
    """The statements that set ``apart`` to the difference of both signals' codes."""
    assert signal.twin is not None
    other, name = signal.twin.signal, raw_name(signal.twin.signal)
    yield f"    {name}: i32 = {gathered(other, frame)}"
    same = name
    if signal.twin.inverted:
        # the complement of a code, in the signal's own width
        same = f"({-1 if other.signed else (1 << other.length) - 1} - {name})"
    yield f"    {raw_name(signal)}_apart: i32 = {raw_name(signal)} - {same}"


def disagrees(signal: MappedSignal) -> str:
    """The condition that the second signal contradicts the first."""
    assert signal.twin is not None
    apart, tolerance = f"{raw_name(signal)}_apart", signal.twin.tolerance
    return f"{apart} > {tolerance} or {apart} < {-tolerance}"


def unpacked(signal: MappedSignal) -> str:
    """The field's value for a raw code, limited to the field's range."""
    place, name = signal.place, raw_name(signal)
    value = _scaled(name, signal.scale, signal.offset)
    if signal.real:
        value = f"fixed_of({name}, {_thirty_bits(signal.scale)})"
    whole = value == name and not signal.signed and signal.minus is None
    if whole and place.lo <= 0 and (1 << signal.length) - 1 <= place.hi:
        return value
    value = f"clamp({value}, {place.lo}, {place.hi})"
    return f"byte({value})" if place.lo >= 0 and place.hi <= 255 else value


def share(signal: MappedSignal, count: int) -> str:
    """A raw code's part of a mean of ``count`` signals, 1: of a sum, in the field's format."""
    return _scaled(raw_name(signal), signal.scale / count, signal.offset / count)


def packed(signal: MappedSignal) -> str:
    """The raw code of a field, rounded and limited to the DBC's range."""
    place = signal.place
    source = f"ecu.{place.text}"
    if place.mask is not None:
        source = f"({source} & {place.mask})"
    if signal.real:
        ends = sorted(Fraction(real_of(n)) * signal.scale for n in (signal.raw_lo, signal.raw_hi))
        lo = min(max(place.lo, ceil(ends[0])), place.hi)
        hi = max(min(place.hi, floor(ends[1])), lo)
        limited = source if (lo, hi) == (place.lo, place.hi) else f"clamp({source}, {lo}, {hi})"
        return f"code_of({limited}, {_thirty_bits(1 / signal.scale)})"
    value = _scaled(source, 1 / signal.scale, -signal.offset / signal.scale)
    if value == source and signal.raw_lo <= place.lo and place.hi <= signal.raw_hi:
        return value.removeprefix("(").removesuffix(")")
    return f"clamp({value}, {signal.raw_lo}, {signal.raw_hi})"


def available(signal: MappedSignal, frame: Sequence[str]) -> str:
    """The condition that a raw code is not reserved and is said to be valid; "" where it always is.

    ``frame`` are the locals that hold the words of the frame.
    """
    top = (1 << signal.length) // (2 if signal.signed else 1)
    codes, name = signal.unavailable, raw_name(signal)
    conditions = [f"{name} != {code}" for code in codes]
    if codes and codes == tuple(range(top - len(codes), top)):
        conditions = [f"{name} < {codes[0]}"]
    if signal.real:
        conditions = [f"({name} & {INFINITE}) != {INFINITE}"]
    if signal.validity is not None:
        code = gathered(signal.validity.signal, frame)
        terms = [f"({code}) == {its}" for its in signal.validity.codes]
        conditions.append(terms[0] if len(terms) == 1 else f"({' or '.join(terms)})")
    return " and ".join(conditions)


def wrapped(line: str, width: int) -> Iterable[str]:
    """Break an overlong line after its outermost opening parenthesis."""
    if len(line) <= width:
        yield line
        return
    opening = line.index("(")
    depth, closing = 1, opening
    while depth:
        closing += 1
        depth += {"(": 1, ")": -1}.get(line[closing], 0)
    indent = " " * (len(line) - len(line.lstrip()))
    yield line[: opening + 1]
    yield f"{indent}    {line[opening + 1 : closing]}"
    yield f"{indent}{line[closing:]}"


def _scaled(variable: str, scale: Fraction, offset: Fraction) -> str:
    """``scale`` * variable + ``offset``, as one multiply and, where needed, one rounding shift."""
    shift = _shift(scale)
    factor = round(scale * 2**shift)
    text = variable if factor == 1 else f"{variable} * {factor}"
    added = round(offset * 2**shift)
    if added:
        text = f"{text} {'+' if added > 0 else '-'} {abs(added)}"
    return f"rsh({text}, {shift})" if shift else text


def _shift(scale: Fraction) -> int:
    """The least shift that makes ``scale`` an integer, or one that keeps 30 bits of it."""
    denominator = scale.denominator
    exact = denominator.bit_length() - 1
    if denominator == 1 << exact and abs(scale) * denominator < 1 << FACTOR_BITS:
        return exact
    return min(_normal_shift(scale), LARGEST_SHIFT)


def _normal_shift(scale: Fraction) -> int:
    """The shift by which ``scale`` has 30 bits."""
    magnitude = floor(abs(scale)).bit_length() if abs(scale) >= 1 else 0
    while abs(scale) * 2 ** (FACTOR_BITS - magnitude) < 1 << (FACTOR_BITS - 1):
        magnitude -= 1
    return FACTOR_BITS - magnitude


def _thirty_bits(scale: Fraction) -> str:
    """The factor of 30 bits, and the shift, of a floating-point number."""
    shift = _normal_shift(scale)
    return f"{round(scale * Fraction(2) ** shift)}, {shift}"


def snake(name: str) -> str:
    """A signal's name in the generated code: snake case."""
    parts: list[str] = []
    for i, letter in enumerate(name):
        after_lower = i > 0 and (name[i - 1].islower() or name[i - 1].isdigit())
        if letter.isupper() and after_lower:
            parts.append("_")
        parts.append(letter.lower())
    text = "".join(parts)
    return text if text.isascii() and text.isidentifier() else "".join(map(_plain, text))


def _plain(letter: str) -> str:
    """A letter valid in C and the subset; code numbers keep names distinct."""
    return letter if letter.isascii() and (letter.isalnum() or letter == "_") else f"_{ord(letter)}"
