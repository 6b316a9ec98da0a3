"""Numbers in a frame: places of any width, byte order and alignment.

Bits are counted as in the E2E protocol specification: bit 8 k + b is bit b of byte k.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from canroll.codegen.frame.raw_signal import BitPiece


@dataclass(frozen=True, slots=True)
class Place:
    """The bits of a frame that hold one number, its least significant bit first."""

    bits: tuple[int, ...]

    @property
    def width(self) -> int:
        """Number of its bits."""
        return len(self.bits)

    @property
    def pieces(self) -> tuple[BitPiece, ...]:
        """Its bits byte by byte, as far as they follow each other."""
        found: list[BitPiece] = []
        for i, place in enumerate(self.bits):
            byte, bit = divmod(place, 8)
            last = found[-1] if found else None
            if last is not None and (last.byte, last.bit + last.width) == (byte, bit):
                found[-1] = BitPiece(byte, last.bit, last.width + 1, last.signal_bit)
            else:
                found.append(BitPiece(byte, bit, 1, i))
        return tuple(found)

    def low(self, width: int) -> "Place":
        """The place of its ``width`` least significant bits."""
        return Place(self.bits[:width])

    def mask(self, byte: int) -> int:
        """Its bits in one byte of the frame."""
        return sum(1 << bit % 8 for bit in set(self.bits) if bit // 8 == byte)

    def read(self, payload: Sequence[int]) -> int:
        """The number in a frame."""
        return sum((payload[bit // 8] >> bit % 8 & 1) << k for k, bit in enumerate(self.bits))

    def write(self, payload: bytearray, value: int) -> None:
        """Put a number into a frame; bits of it beyond the place's are dropped."""
        for k, bit in enumerate(self.bits):
            kept = payload[bit // 8] & ~(1 << bit % 8)
            payload[bit // 8] = kept | (value >> k & 1) << bit % 8


def little(bit: int, width: int) -> Place:
    """A number from ``bit`` up, little-endian."""
    return Place(tuple(range(bit, bit + width)))


def big(byte: int, width: int) -> Place:
    """A number of whole bytes from ``byte`` on, the most significant one first."""
    last = byte + width // 8 - 1
    return Place(tuple(8 * (last - k // 8) + k % 8 for k in range(width)))


def joined(places: Iterable[Place]) -> Place:
    """One number from several places, the least significant first."""
    return Place(tuple(bit for place in places for bit in place.bits))
