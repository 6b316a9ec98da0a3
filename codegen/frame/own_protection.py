"""Manufacturers' protection: any checksum and any counter, as a map describes them."""

from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import Any

from cantools.database.can import Message

from canroll import documents
from canroll.codegen.frame.checksum import Checksum
from canroll.codegen.frame.checksum_units import Frame, signal_of, units_of
from canroll.codegen.frame.crc_kinds import CRCS, Crc
from canroll.codegen.frame.place import Place, big, joined, little
from canroll.codegen.frame.raw_signal import bits_of
from canroll.errors import CanrollError, UnknownNameError

OF_A_PLACE = ("signal", "byte", "bit", "width", "order")
OF_A_CRC = ("start", "end", "reflect_in", "reflect_out")
KEYS = {
    "crc": ("polynomial", *OF_A_CRC),
    "sum": ("start", "end", "unit", "carry", "negate"),
    "xor": ("start", "end", "unit"),
}
"""Keys of a checksum by its fold, beside its place, ``over`` and ``constant``."""
OF_A_CHECKSUM = tuple(
    dict.fromkeys((*OF_A_PLACE, "method", "over", "constant", "function", *sum(KEYS.values(), ())))
)
METHODS = ("xor", "sum", "crc", "crc8", *CRCS)
UNITS = (1, 4, 8, 16, 32)
WIDEST = {"crc": 64, "sum": 32, "xor": 32, "function": 64}
WIDEST_COUNTER = 32
HELD_BITS = 30
"""Bits of a counter that ECU and plant hold; of a wider one those above are 0 and not looked at."""


def place_of(
    table: Mapping[str, Any], width: int, message: Message, where: str, what: str
) -> Place:
    """The bits that a table gives: of one signal or several, or from a bit or byte on.

    Raises:
        CanrollError: none or several are given, or they are not in the frame.
    """
    given = [key for key in ("signal", "byte", "bit") if key in table]
    if len(given) != 1:
        raise CanrollError(f"{where}: give one of signal, byte or bit of the {what}")
    if given == ["signal"]:
        for key in ("width", "order"):
            if key in table:
                raise CanrollError(f"{where}: {key} of the {what} is that of its signal: omit it")
        names = table["signal"] if isinstance(table["signal"], list) else [table["signal"]]
        place = joined(Place(tuple(bits_of(signal_of(n, message, where)))) for n in names)
    else:
        place = _place_by_number(table, given[0], width, where, what)
    if not place.bits or max(place.bits) >= 8 * message.length:
        raise CanrollError(
            f"{where}: checksum and counter must be inside {8 * message.length} bits"
        )
    if len(set(place.bits)) < place.width:
        raise CanrollError(f"{where}: two signals of the {what} share a bit")
    return place


def _place_by_number(
    table: Mapping[str, Any], key: str, width: int, where: str, what: str
) -> Place:
    start = number(table, key, 0, where)
    width = number(table, "width", width, where)
    order = table.get("order", "little")
    if order not in ("little", "big"):
        raise UnknownNameError(f"order of the {what} in {where}", order, ("little", "big"))
    if not 1 <= width <= 64:
        raise CanrollError(f"{where}: width of the {what} must be 1 to 64 bits")
    if order == "little":
        return little(start * (8 if key == "byte" else 1), width)
    if key == "bit" or width % 8:
        raise CanrollError(f"{where}: order big needs whole bytes from a byte on, or a signal")
    return big(start, width)


def number(given: Mapping[str, Any], key: str, default: int, where: str) -> int:
    """A whole number of a table, at least 0."""
    value = given.get(key, default)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise CanrollError(f"{where}: {key} must be an integer of at least 0, not {value!r}")
    return value


def _flag(given: Mapping[str, Any], key: str, default: bool, where: str) -> bool:
    value = given.get(key, default)
    if not isinstance(value, bool):
        raise CanrollError(f"{where}: {key} must be true or false, not {value!r}")
    return value


def own_counter(entry: object, message: Message, where: str) -> tuple[Place, int] | None:
    """Place and number of values of a counter, None where there is none."""
    if entry is None:
        return None
    table = _known(entry, "counter", (*OF_A_PLACE, "values"), where)
    place = place_of(table, 4, message, where, "counter")
    if place.width > WIDEST_COUNTER:
        raise CanrollError(f"{where}: a counter has up to {WIDEST_COUNTER} bits")
    values = number(table, "values", 1 << place.width, where)
    most = 1 << place.width
    if not 2 <= values <= most or most > values > 1 << HELD_BITS:
        raise CanrollError(f"{where}: a counter of {place.width} bits cannot have {values} values")
    return place, values


def own_checksum_of(  # noqa: PLR0917
    entry: object,
    message: Message,
    length: int,
    counter: Place | None,
    where: str,
    folder: Path,
) -> Checksum | None:
    """The checksum that a table describes, None where there is none.

    Raises:
        CanrollError: a wrong entry.
    """
    if entry is None:
        return None
    table = _known(entry, "checksum", OF_A_CHECKSUM, where)
    if "function" in table:
        return _of_function(table, message, where, folder)
    method = str(table.get("method", ""))
    if method not in METHODS:
        raise UnknownNameError(f"checksum method in {where}", method, METHODS)
    fold = method if method in ("sum", "xor") else "crc"
    for key in table:
        if key not in (*OF_A_PLACE, "method", "over", "constant", *KEYS[fold]):
            raise CanrollError(f"{where}: {key} is not of a checksum by {method}: omit it")
    kind = CRCS.get(method)
    if (fold == "crc" and kind is None) != ("polynomial" in table):
        raise CanrollError(
            f"{where}: a polynomial is required by methods crc and crc8 and not allowed otherwise"
        )
    place = place_of(table, kind.width if kind else 8, message, where, "checksum")
    _refuse_width(place, kind.width if kind else 8 if method == "crc8" else 0, fold, where)
    unit = number(table, "unit", 8, where)
    if unit not in UNITS:
        raise CanrollError(f"{where}: unit {unit} must be {', '.join(map(str, UNITS))} bits")
    frame = Frame(message, length, place, counter, unit)
    return _folded(table, fold, kind, frame, where)


def _folded(
    table: Mapping[str, Any], fold: str, kind: Crc | None, frame: Frame, where: str
) -> Checksum:
    kind = kind or Crc(frame.own.width, number(table, "polynomial", 0, where), 0, 0, False)
    start = number(table, "start", kind.start, where)
    end = number(table, "end", kind.end, where)
    if max(kind.polynomial, start, end) >> frame.own.width:
        raise CanrollError(
            f"{where}: polynomial, start and end of a checksum must fit {frame.own.width} bits"
        )
    over = table.get("over", ["frame"])
    if not isinstance(over, list):
        raise CanrollError(f"{where}: over must be a list, of what the checksum takes in")
    if "constant" in table:
        over = [*over, table["constant"]]
    return Checksum(
        frame.own,
        fold,
        units_of(over, frame, where),
        frame.unit,
        start,
        end,
        kind.polynomial,
        reflect_in=_flag(table, "reflect_in", kind.reflected, where),
        reflect_out=_flag(table, "reflect_out", kind.reflected, where),
        carry=_flag(table, "carry", False, where),
        negate=_flag(table, "negate", False, where),
    )


def _of_function(table: Mapping[str, Any], message: Message, where: str, folder: Path) -> Checksum:
    for key in table:
        if key not in (*OF_A_PLACE, "function"):
            raise CanrollError(f"{where}: {key} is for the function to decide: omit it")
    place = place_of(table, 8, message, where, "checksum")
    _refuse_width(place, 0, "function", where)
    # parser, prover and translator, for the few maps that name a function
    from canroll.codegen.frame.own_checksum import own_checksum  # noqa: PLC0415

    own = own_checksum(str(table["function"]), folder, f"{where} checksum.function")
    if own.size > max(message.length, 8):
        raise CanrollError(
            f"{own.path}: {own.name} reads {own.size} bytes, {message.name} has {message.length}"
        )
    checksum = Checksum(place, "function", function=own)
    rng = Random(1)
    for _ in range(64):
        payload = bytearray(rng.randbytes(message.length))
        before = checksum.value(payload, message.frame_id, 0)
        place.write(payload, rng.getrandbits(place.width))
        if checksum.value(payload, message.frame_id, 0) != before:
            raise CanrollError(
                f"{own.path}: {own.name} depends on the checksum's own bits of {message.name}"
            )
    return checksum


def _refuse_width(place: Place, width: int, fold: str, where: str) -> None:
    if width and place.width != width:
        raise CanrollError(f"{where}: this checksum has {width} bits, its place {place.width}")
    if place.width > WIDEST[fold]:
        raise CanrollError(f"{where}: a checksum of this kind has up to {WIDEST[fold]} bits")


def _known(entry: object, name: str, keys: tuple[str, ...], where: str) -> Mapping[str, Any]:
    table = documents.table(entry, f"{where}: {name}")
    documents.refuse_unknown(table, keys, f"key of {name} in {where}")
    return table
