"""Support for running the integer subset in CPython: its types, records and intrinsics.

The subset is Python restricted to what a microcontroller offers. A module holds integer constants,
constant tables, records and functions; a function holds annotated locals, assignments, ``if``,
``for … in range(…)``, ``return`` and calls. There are no floats, no allocation, no recursion, no
``//`` and no ``%``. ``canroll.codegen.c99.emit`` translates it to C99 and refuses everything else;
this module itself is not translated: the C prelude has the same intrinsics.

Arithmetic is exact. A value is stored in an ``i32`` only where it fits: through :func:`sat32`,
:func:`sat31`, :func:`scaled`, :func:`clamp`, :func:`narrow` or because its range shows it.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

i32 = int
"""A signed 32-bit integer."""
i64 = int
"""A signed 64-bit integer."""
u8 = int
"""An unsigned 8-bit integer."""
u16 = int
"""An unsigned 16-bit integer: for tables and locals, records have none."""
u32 = int
"""An unsigned 32-bit integer: for tables and locals whose bits count, records have none."""

BITS_31_MIN, BITS_31_MAX = -(2**30), 2**30 - 1
I32_MIN, I32_MAX = -(2**31), 2**31 - 1
I64_MIN, I64_MAX = -(2**63), 2**63 - 1

Record = TypeVar("Record")


@dataclass(frozen=True, slots=True)
class F:
    """Declaration of one field of a record: its range, Q format, unit and meaning.

    ``q`` is the number of fractional bits: a stored integer n stands for n / 2**q ``unit``.
    Every store keeps ``lo <= n <= hi``. ``volatile`` marks a field that an interrupt may write.
    """

    lo: int
    hi: int
    q: int
    unit: str
    meaning: str
    volatile: bool = False


@dataclass(frozen=True, slots=True)
class Field:
    """One row of a record's field table; ``shape`` is () for a scalar, ``kind`` i32 or u8."""

    name: str
    kind: str
    shape: tuple[int, ...]
    f: F


def fields(record_class: type) -> tuple[Field, ...]:
    """Return the field table of a record class, in the order of its memory layout.

    A ``u8`` is distinguished from an ``i32`` by its range, as both are ``int`` to CPython.
    """
    return _fields(record_class)


@cache
def _fields(record_class: Any) -> tuple[Field, ...]:  # noqa: ANN401
    table = []
    for name, hint in get_type_hints(record_class, include_extras=True).items():
        if get_origin(hint) is not Annotated:
            raise TypeError(f"{record_class.__name__}.{name} lacks its field description")
        *shape, f = get_args(hint)[1:]
        kind = "u8" if 0 <= f.lo and f.hi <= 255 else "i32"
        table.append(Field(name, kind, tuple(shape), f))
    return tuple(table)


def filled(shape: tuple[int, ...], value: int) -> Any:  # noqa: ANN401
    """Return an array of ``shape``, or a scalar, of one value."""
    return [filled(shape[1:], value) for _ in range(shape[0])] if shape else value


def record(record_class: type[Record]) -> type[Record]:
    """Give a class of annotated fields its one constructor: every field zero, or its minimum."""
    table = fields(record_class)

    def construct(self: Record) -> None:
        for field in table:
            setattr(self, field.name, filled(field.shape, min(max(0, field.f.lo), field.f.hi)))

    record_class.__init__ = construct  # type: ignore[assignment]
    return record_class


def sat32(v: i64) -> i32:
    """Return ``v`` limited to the range of an i32."""
    return clamp(v, I32_MIN, I32_MAX)


def sat31(v: i64) -> i32:
    """Return ``v`` limited to 31 bits, -2**30 to 2**30 - 1: a sum of two of them fits an i32."""
    if v > BITS_31_MAX:
        return BITS_31_MAX
    if v < BITS_31_MIN:
        return BITS_31_MIN
    return v


def scaled(v: i64, n: i32) -> i32:
    """Return v / 2**n, rounded to nearest as by :func:`rsh`, limited as by :func:`sat31`."""
    return sat31((v + (1 << (n - 1))) >> n)


def clamp(v: i64, lo: i32, hi: i32) -> i32:
    """Return ``v`` limited to [lo, hi]."""
    if v > hi:
        return hi
    if v < lo:
        return lo
    return v


def rsh(v: i64, n: i32) -> i64:
    """Return v / 2**n, rounded to nearest, halves upwards; 1 <= n <= 62."""
    return (v + (1 << (n - 1))) >> n


def absolute(v: i64) -> i64:
    """Return the magnitude of ``v``."""
    return abs(v)


def tdiv(a: i64, b: i64) -> i64:
    """Return a / b rounded towards zero, as C divides; ``b`` is not zero."""
    q = abs(a) // abs(b)
    return -q if (a < 0) != (b < 0) else q


def byte(v: i32) -> u8:
    """Return the low eight bits of ``v``."""
    return v & 255


def to_u32(v: i32) -> u32:
    """Return the 32 bits of ``v`` as an unsigned number."""
    return v & 0xFFFFFFFF


def to_i32(v: u32) -> i32:
    """Return the number whose 32 bits are those of ``v``."""
    return v - (1 << 32) if v >> 31 else v


def narrow(v: i64) -> i32:
    """Return ``v``, which is known to fit an i32: checked here and by the prover, a cast in C."""
    if not I32_MIN <= v <= I32_MAX:
        raise OverflowError(f"{v} does not fit 32 bits")
    return v


def clear(record: Any) -> None:  # noqa: ANN401
    """Make every element of a record zero."""
    for field in fields(record.__class__):
        setattr(record, field.name, filled(field.shape, 0))


def word(record: Any, k: i32) -> i32:  # noqa: ANN401
    """Return the ``i32`` at byte 4 ``k`` of a record as C lays it out.

    Where bytes are there, what it is depends on the machine; here it is the little-endian one.
    """
    value = 0
    for name, indices, shift in words(record.__class__)[k]:
        found = getattr(record, name)
        for index in indices:
            found = found[index]
        value |= (found & 0xFFFFFFFF) << shift
    return value - (1 << 32) if value >> 31 else value


def octet(record: Any, k: i32) -> u8:  # noqa: ANN401
    """Return byte ``k`` of a record as C lays it out, of an ``i32`` as a little-endian machine."""
    return word(record, k >> 2) >> 8 * (k & 3) & 255


def set_octet(record: Any, k: i32, value: u8) -> None:  # noqa: ANN401
    """Set byte ``k`` of a calibration as C lays it out, whatever its field's range."""
    for name, indices, shift in words(record.__class__)[k >> 2]:
        width = 32 if wide(record.__class__, name) else 8
        low = 8 * (k & 3) - shift
        if not 0 <= low < width:
            continue
        row, before = None, getattr(record, name)
        for index in indices:
            row, before = before, before[index]
        found = (before & 0xFFFFFFFF) & ~(255 << low) | value << low
        found = to_i32(found) if width == 32 else found
        if row is None:
            setattr(record, name, found)
        else:
            row[indices[-1]] = found


def set_word(record: Any, k: i32, value: i32) -> None:  # noqa: ANN401
    """Set the ``i32`` at byte 4 ``k`` of a calibration, whatever its field's range."""
    for b in range(4):
        set_octet(record, 4 * k + b, value >> 8 * b & 255)


def bytes_of(record: Any) -> i32:  # noqa: ANN401
    """Return the bytes of a record up to the end of its last field, as C lays it out."""
    last, (name, _) = max(places(record.__class__).items())
    return last + (4 if wide(record.__class__, name) else 1)


@cache
def wide(record_class: Any, name: str) -> bool:  # noqa: ANN401
    """Return whether a field has 32 bits."""
    return any(field.name == name and field.kind == "i32" for field in fields(record_class))


@cache
def words(record_class: Any) -> list[list[tuple[str, tuple[int, ...], int]]]:  # noqa: ANN401
    """Return of every four bytes the elements in them: field, indices, shift of the low bit."""
    table = places(record_class)
    size = -(-(max(table) + 1) // 4)
    return [
        [(*table[4 * k + b], 8 * b) for b in range(4) if 4 * k + b in table] for k in range(size)
    ]


@cache
def places(record_class: type[Any]) -> dict[int, tuple[str, tuple[int, ...]]]:
    """Return field and indices of every element, by its first byte."""
    table: dict[int, tuple[str, tuple[int, ...]]] = {}
    end = 0
    for field in fields(record_class):
        width = 4 if field.kind == "i32" else 1
        end = -(-end // width) * width
        for indices in product(*map(range, field.shape)):
            table[end] = (field.name, indices)
            end += width
    return table
