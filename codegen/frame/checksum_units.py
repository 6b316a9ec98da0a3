"""What a checksum takes in, in order: the bytes of its frame, the frame's identity, constants.

The list ``over`` of a map has an entry for each; :func:`units_of` makes the units of it.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from cantools.database.can import Message, Signal

from canroll import documents
from canroll.codegen.frame.checksum import LISTED, Bits, Unit
from canroll.codegen.frame.place import Place
from canroll.codegen.frame.raw_signal import bits_of
from canroll.errors import CanrollError, UnknownNameError

ENTRIES = ("frame", "id", "length", "counter", "byte 3", "bytes 1-7")
"""Entries of ``over`` that are words; besides there are constants, lists of them and tables."""
IDENTITY = {False: 2, True: 4}
"""Bytes of an identifier, by whether it is extended."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame as its checksum sees it.

    Attributes:
        message: its description.
        length: protected bytes.
        own: place of the checksum.
        counter: place of the counter, if any.
        unit: bits of a unit.
    """

    message: Message
    length: int
    own: Place
    counter: Place | None
    unit: int


def frame_units(own: Place, length: int) -> tuple[Unit, ...]:
    """The bytes of a frame but those that are the checksum's; of a shared one the other bits."""
    masks = [(k, 255 & ~own.mask(k)) for k in range(length)]
    return tuple((Bits("byte", k, mask),) for k, mask in masks if mask)


def identity_units(size: int) -> tuple[Unit, ...]:
    """The bytes of the frame's identity, the least significant first."""
    return tuple((Bits("identity", shift=8 * k),) for k in range(size))


def constant(value: int) -> Unit:
    """A constant."""
    return (Bits("constant", value, (1 << max(8, value.bit_length())) - 1),)


def listed(values: Sequence[int]) -> Unit:
    """One of a list of constants, by the value of the counter."""
    return (Bits("listed", tuple(values), (1 << max(8, max(values).bit_length())) - 1),)


def units_of(entries: Iterable[Any], frame: Frame, where: str) -> tuple[Unit, ...]:
    """The units of a list ``over``.

    Raises:
        CanrollError: an entry that means nothing; ``where`` is named.
    """
    found: list[Unit] = []
    # bytes that follow each other in the list make words, all else is a unit of its own
    parts = [part for entry in entries for part in _parts(entry, frame, where)]
    for is_byte, group in groupby(parts, key=lambda part: part[0]):
        units = [unit for _, unit in group]
        found += _words(units, frame.unit, where) if is_byte and frame.unit > 8 else units
    if not found:
        raise CanrollError(f"{where}: the checksum takes in nothing")
    return tuple(found)


def _parts(entry: Any, frame: Frame, where: str) -> Iterator[tuple[bool, Unit]]:  # noqa: ANN401
    """Units of one entry, and whether they are bytes of the frame."""
    if isinstance(entry, Mapping):
        yield from ((False, unit) for unit in _table(entry, frame, where))
    elif _is_number(entry, frame.unit):
        yield False, constant(entry)
    elif isinstance(entry, list):
        yield False, listed(_list(entry, frame, where))
    elif entry == "frame":
        yield from ((True, unit) for unit in frame_units(frame.own, frame.length))
    elif entry == "id":
        yield from ((False, unit) for unit in _identity(frame))
    elif entry == "length":
        yield False, constant(frame.length)
    elif entry == "counter":
        if frame.counter is None:
            raise CanrollError(f"{where}: the checksum is over a counter, and there is none")
        yield from ((False, unit) for unit in _split(frame.counter, frame))
    else:
        yield from ((True, unit) for unit in _bytes(entry, frame, where))


def _bytes(entry: Any, frame: Frame, where: str) -> Iterator[Unit]:  # noqa: ANN401
    """Bytes by number, upwards or downwards; bits of the checksum in them count as 0."""
    word = (
        re.fullmatch(r"bytes? (\d{1,2})(?:-(\d{1,2}))?", entry) if isinstance(entry, str) else None
    )
    if word is None:
        if isinstance(entry, int):
            raise CanrollError(
                f"{where}: {entry!r} in over must be a number of up to {max(frame.unit, 8)} bits"
            )
        raise UnknownNameError(f"entry of over in {where}", str(entry), ENTRIES)
    first = int(word[1])
    last = int(word[2] or first)
    if max(first, last) >= frame.message.length:
        raise CanrollError(
            f"{where}: {entry!r} in over is outside the {frame.message.length} bytes of "
            f"{frame.message.name}"
        )
    step = 1 if last >= first else -1
    for k in range(first, last + step, step):
        yield (Bits("byte", k, 255 & ~frame.own.mask(k)),)


def _words(units: Sequence[Unit], width: int, where: str) -> Iterator[Unit]:
    """Words of bytes, the first one most significant."""
    size = width // 8
    if len(units) % size:
        raise CanrollError(f"{where}: {len(units)} bytes in over do not make words of {width} bits")
    for start in range(0, len(units), size):
        word = units[start : start + size]
        yield tuple(
            Bits(bits.source, bits.at, bits.mask, bits.shift, 8 * (size - 1 - k))
            for k, (bits,) in enumerate(word)
        )


def _table(entry: Mapping[str, Any], frame: Frame, where: str) -> Iterable[Unit]:
    """A signal, or the identifier, with its order of bytes."""
    documents.refuse_unknown(entry, ("signal", "id", "order"), f"key of over in {where}")
    order = entry.get("order", "little")
    if order not in ("little", "big"):
        raise UnknownNameError(f"order in over in {where}", order, ("little", "big"))
    if ("signal" in entry) == ("id" in entry):
        raise CanrollError(f"{where}: a table in over has either signal or id")
    if "id" in entry:
        if entry["id"] is not True:
            raise CanrollError(f'{where}: id in over is true, or the word "id" alone')
        units = _identity(frame)
    else:
        signal = signal_of(entry["signal"], frame.message, where)
        place = Place(tuple(bits_of(signal)))
        if set(place.bits) & set(frame.own.bits):
            raise CanrollError(f"{where}: the checksum is over its own signal {signal.name}")
        units = _split(place, frame)
    return reversed(units) if order == "big" else units


def signal_of(name: Any, message: Message, where: str) -> Signal:  # noqa: ANN401
    """The signal of a frame that has a name.

    Raises:
        UnknownNameError: there is none.
    """
    known = {signal.name: signal for signal in message.signals}
    if not isinstance(name, str) or name not in known:
        raise UnknownNameError(f"signal of {message.name} in {where}", name, known)
    return known[name]


def _identity(frame: Frame) -> list[Unit]:
    size = IDENTITY[bool(frame.message.is_extended_frame)]
    if frame.unit <= 8:
        return list(identity_units(size))
    return [
        tuple(Bits("identity", shift=k + j, left=j) for j in range(0, frame.unit, 8))
        for k in range(0, 8 * size, frame.unit)
    ]


def _split(place: Place, frame: Frame) -> list[Unit]:
    """A number as units, the least significant first; bytes where a unit is less."""
    width = max(frame.unit, 8)
    units = []
    for start in range(0, place.width, width):
        part = Place(place.bits[start : start + width])
        units.append(
            tuple(
                Bits("byte", p.byte, (1 << p.width) - 1, p.bit, p.signal_bit) for p in part.pieces
            )
        )
    return units


def _is_number(value: object, unit: int) -> bool:
    whole = isinstance(value, int) and not isinstance(value, bool)
    return whole and 0 <= value < 1 << max(unit, 8)  # type: ignore[operator]


def _list(values: Sequence[Any], frame: Frame, where: str) -> tuple[int, ...]:
    if len(values) != LISTED or not all(_is_number(value, frame.unit) for value in values):
        raise CanrollError(
            f"{where}: a list in over has {LISTED} numbers of up to {max(frame.unit, 8)} bits, one "
            "for each value of the counter"
        )
    if frame.counter is None or frame.counter.width > 4:
        raise CanrollError(
            f"{where}: a constant for each counter value needs a counter of up to {LISTED}"
        )
    return tuple(values)
