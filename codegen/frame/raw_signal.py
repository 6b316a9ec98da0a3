"""The raw code of a signal: its bits in the frame, and what a map says of it as numbers."""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from cantools.database import Signal

from canroll.errors import CanrollError, UnknownNameError

LONGEST_SIGNAL = 30
REAL_BITS = 32


@dataclass(frozen=True, slots=True)
class BitPiece:
    """``width`` bits of a signal from ``signal_bit`` up, in ``byte`` from ``bit`` up."""

    byte: int
    bit: int
    width: int
    signal_bit: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RawSignal:
    """Position of a signal's raw code in the frame.

    ``real``: the code, signed, is the bits of a floating-point number (IEEE 754 single precision).
    """

    name: str
    pieces: tuple[BitPiece, ...]
    length: int
    signed: bool
    real: bool = False


def integer_signal(name: object, known: Mapping[str, Signal], where: str) -> Signal:
    """An integer signal of the frame, of a width the firmware supports."""
    signal = number_signal(name, known, where)
    if signal.is_float:
        raise CanrollError(f"{where}: {name} is a floating-point number, not an integer")
    return signal


def number_signal(name: object, known: Mapping[str, Signal], where: str) -> Signal:
    """An integer or floating-point signal of the frame, of a width the firmware supports."""
    if not isinstance(name, str) or name not in known:
        raise UnknownNameError(f"signal in {where}", str(name), known)
    signal = known[name]
    if signal.is_float and signal.length == REAL_BITS:
        return signal
    if signal.is_float:
        raise CanrollError(
            f"{where}: {name} is a floating-point number of {signal.length} bits (SIG_VALTYPE_): "
            f"only those of {REAL_BITS} bits can be mapped"
        )
    if signal.length > LONGEST_SIGNAL:
        raise CanrollError(f"{where}: {name} must be an integer of at most {LONGEST_SIGNAL} bits")
    return signal


def fraction(table: Mapping[str, Any], key: str, default: float, where: str) -> Fraction:
    """An exact number from the map's decimals, else from the DBC."""
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise CanrollError(f"{where}: {key} must be a number, not {value!r}")
    return Fraction(str(value))


def code_range(signal: Signal) -> tuple[int, int]:
    """Return the least and the greatest raw code of an integer signal."""
    span = 1 << signal.length
    return (-span // 2, span // 2 - 1) if signal.is_signed else (0, span - 1)


def real_of(code: int) -> float:
    """Return the floating-point number with the bits of ``code``, a signed number of 32 bits."""
    return float(struct.unpack("<f", struct.pack("<i", code))[0])


def code_of(number: float) -> int:
    """Return the bits, as a signed number, of the nearest floating-point number of 32 bits."""
    return int(struct.unpack("<i", struct.pack("<f", number))[0])


def raw_signal(signal: Signal) -> RawSignal:
    """A signal's raw code alone."""
    return RawSignal(
        name=signal.name,
        pieces=pieces_of(signal),
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


def pieces_of(signal: Signal) -> tuple[BitPiece, ...]:
    """Split a signal at byte boundaries, its least significant bit first."""
    pieces: list[BitPiece] = []
    for i, place in enumerate(bits_of(signal)):
        byte, bit = divmod(place, 8)
        last = pieces[-1] if pieces else None
        if last is not None and last.byte == byte:
            pieces[-1] = BitPiece(byte, last.bit, last.width + 1, last.signal_bit)
        else:
            pieces.append(BitPiece(byte, bit, 1, i))
    return tuple(pieces)
