"""One checksum of a frame: what it takes in, how that is folded into a number, where it stands.

Every kind is the same four steps. Units (bytes, nibbles, words, whole signals) come in an order,
from the frame, its identity or constants. A fold makes a number of them: a CRC, a sum or an XOR.
A finish negates it or inverts bits. Its place holds the number.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, reduce
from operator import xor
from pathlib import Path
from typing import Any

from canroll.codegen.frame.place import Place

LISTED = 16
"""Entries of a list that the counter selects from."""
PREFIX = "maker_"
"""What names of the firmware's modules begin with that files of users became."""


@dataclass(frozen=True, slots=True)
class Bits:
    """``((source >> shift) & mask) << left``: up to 32 bits of a unit.

    The source is byte ``at`` of the frame, the frame's identity, the constant ``at``, or with
    "listed" that of the constants ``at`` which the counter selects.
    """

    source: str
    at: int | tuple[int, ...] = 0
    mask: int = 255
    shift: int = 0
    left: int = 0

    def value(self, payload: Sequence[int], identity: int, count: int) -> int:
        """Its value in a frame with counter ``count``."""
        source = identity
        if isinstance(self.at, tuple):
            source = self.at[count % len(self.at)]
        elif self.source == "byte":
            source = payload[self.at]
        elif self.source == "constant":
            source = self.at
        return (source >> self.shift & self.mask) << self.left

    @property
    def most(self) -> int:
        """The largest value that it can have."""
        return self.mask << self.left


Unit = tuple[Bits, ...]
"""What one step of a fold takes in: bits that do not overlap."""


@dataclass(frozen=True)
class OwnChecksum:
    """A user's function for a checksum (:mod:`canroll.codegen.frame.own_checksum`).

    Attributes:
        path: its file, for messages.
        source: the file's text.
        name: the function.
        result: kind of what it returns.
        size: bytes of the frame that it is given, at least.
    """

    path: Path
    source: str
    name: str
    result: str
    size: int

    @property
    def module(self) -> str:
        """The firmware's module that the file becomes."""
        return f"{PREFIX}{self.path.stem}"

    @cached_property
    def _function(self) -> Callable[[list[int], int], int]:
        function: Callable[[list[int], int], int] = self.namespace()[self.name]
        return function

    def namespace(self) -> dict[str, Any]:
        """What the file defines, run anew."""
        found: dict[str, Any] = {"__name__": self.module}
        exec(compile(self.source, str(self.path), "exec"), found)
        return found

    def __call__(self, payload: Sequence[int], identifier: int) -> int:
        """Return the checksum of a frame, of which bytes that it does not have are 0."""
        padded = [*payload, *[0] * max(self.size - len(payload), 0)]
        return self._function(padded, identifier)


@dataclass(frozen=True, slots=True)
class Checksum:
    """A checksum; ``start`` and ``end`` are of the width of its place.

    Attributes:
        place: where it stands.
        fold: "crc" (most significant bit first unless ``reflect_in``), "sum", "xor" or "function".
        units: what it takes in, in this order; a CRC eight bits at a time.
        unit: a sum or an XOR splits what it takes in into numbers of so many bits.
        start: of a CRC's register, of an XOR, or of a sum, which is added or subtracted from it.
        end: XORed to the result.
        polynomial: of a CRC, without its highest term.
        reflect_in: a CRC takes the least significant bit of every byte first.
        reflect_out: the bits of a CRC are reversed in the end.
        carry: a sum's carry is added to it (ones' complement).
        negate: a sum is subtracted from its start.
        function: a function of the user's own, instead of all these.
    """

    place: Place
    fold: str
    units: tuple[Unit, ...] = ()
    unit: int = 8
    start: int = 0
    end: int = 0
    polynomial: int = 0
    reflect_in: bool = False
    reflect_out: bool = False
    carry: bool = False
    negate: bool = False
    function: OwnChecksum | None = None

    @property
    def width(self) -> int:
        """Number of its bits."""
        return self.place.width

    @property
    def identified(self) -> bool:
        """Whether it takes in the identity of the frame."""
        used = any(bits.source == "identity" for unit in self.units for bits in unit)
        return used or self.fold == "function"

    @property
    def register(self) -> int:
        """Bits of the register in which a CRC is calculated: those of an integer type."""
        return next(bits for bits in (8, 16, 32, 64) if self.width <= bits)

    @property
    def lists(self) -> tuple[tuple[int, ...], ...]:
        """The lists of constants that the counter selects from."""
        found = [b.at for unit in self.units for b in unit if isinstance(b.at, tuple)]
        return tuple(dict.fromkeys(found))

    def value(self, payload: bytes | bytearray, identity: int, count: int) -> int:
        """Return the checksum of a frame that has its counter."""
        if self.function is not None:
            return self.function(list(payload), identity) & ((1 << self.width) - 1)
        units = [sum(bits.value(payload, identity, count) for bits in unit) for unit in self.units]
        most = (1 << self.width) - 1
        if self.fold == "crc":
            return self._crc(units) ^ self.end
        parts = [part for unit in units for part in split(unit, self.unit)]
        if self.fold == "xor":
            return reduce(xor, parts, self.start) & most ^ self.end
        total = sum(parts) + (0 if self.negate else self.start)
        while self.carry and total > most:
            total = (total & most) + (total >> self.width)
        return (self.start - total if self.negate else total) & most ^ self.end

    def _crc(self, units: Iterable[int]) -> int:
        value, top = self.start, 1 << self.width - 1
        for unit in units:
            byte = reversed_bits(unit, 8) if self.reflect_in else unit
            for k in reversed(range(8)):
                divide = bool(value & top) != bool(byte >> k & 1)
                value = (value & top - 1) << 1 ^ (self.polynomial if divide else 0)
        return reversed_bits(value, self.width) if self.reflect_out else value

    @property
    def first_register(self) -> int:
        """``start`` as the register of :func:`crc_table` has it."""
        if self.reflect_in:
            return reversed_bits(self.start, self.width)
        return self.start << self.register - self.width

    @property
    def table(self) -> tuple[int, ...]:
        """The 256 entries by which a CRC takes in a byte."""
        return crc_table(self.polynomial, self.width, reflected=self.reflect_in)

    @property
    def most(self) -> int:
        """The largest sum of all that it takes in, without the start."""
        return sum(sum(split(sum(b.most for b in unit), self.unit)) for unit in self.units)


def split(value: int, width: int) -> Iterator[int]:
    """Numbers of ``width`` bits, the least significant first."""
    while value:
        yield value & (1 << width) - 1
        value >>= width


def reversed_bits(value: int, width: int) -> int:
    """The bits of a number in reverse."""
    return sum((value >> k & 1) << width - 1 - k for k in range(width))


@cache
def crc_table(polynomial: int, width: int, *, reflected: bool = False) -> tuple[int, ...]:
    """The lookup table of a CRC in a register of 8, 16, 32 or 64 bits.

    The CRC stands in the high bits of the register, in the low ones where it is reflected.
    """
    register = next(bits for bits in (8, 16, 32, 64) if width <= bits)
    table = []
    for first in range(256):
        if reflected:
            value, divisor = first, reversed_bits(polynomial, width)
            for _ in range(8):
                value = value >> 1 ^ (divisor if value & 1 else 0)
        else:
            value = first << register - 8
            divisor = (polynomial | 1 << width) << register - width
            for _ in range(8):
                value = value << 1 ^ (divisor if value >> register - 1 else 0)
        table.append(value)
    return tuple(table)
