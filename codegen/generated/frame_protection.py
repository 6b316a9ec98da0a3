"""End-to-end protection of one frame: position and coverage of checksum and counter.

AUTOSAR E2E profiles 1, 2, 5 and 22 (*E2E Protocol Specification*, PRS_E2EProtocol) and
manufacturers' schemes: an XOR, a sum or a CRC-8, a constant of the message, a rolling counter.
Positions are those of the specification: bit 8 k + b is bit b of byte k. A protection comes from
the DBC's attributes or from the map (:func:`protection`); :meth:`Protection.apply` defines it.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from cantools.database.can import Message

from canroll import documents
from canroll.errors import CanrollError, UnknownNameError
from codegen.generated.mapped_signal import bits_of

ATTRIBUTES = {
    "E2EProfile": "profile",
    "E2EDataId": "data_id",
    "E2EDataIdList": "data_id",
    "E2EDataIdMode": "data_id_mode",
    "E2ECrcOffset": "crc_offset",
    "E2ECounterOffset": "counter_offset",
    "E2EDataIdNibbleOffset": "data_id_nibble_offset",
    "E2EOffset": "offset",
    "E2EDataLength": "data_length",
}
"""Attributes of a message in the DBC, and the keys of a map that say the same."""
KEYS = {
    "none": (),
    "1": (
        "data_id",
        "data_id_mode",
        "crc_offset",
        "counter_offset",
        "data_id_nibble_offset",
        "data_length",
    ),
    "2": ("data_id", "data_length"),
    "5": ("data_id", "offset", "data_length"),
    "22": ("data_id", "offset", "data_length"),
    "own": ("checksum", "counter", "data_length"),
}
MODES = ("both", "alternating", "low", "nibble")
METHODS = ("xor", "sum", "crc8")
J1850, H2F, CCITT = 0x1D, 0x2F, 0x1021


@dataclass(frozen=True, slots=True)
class Checksum:
    """A checksum over a frame; its own bytes are excluded.

    ``method`` xor, sum, crc8 or crc16 (low byte first in the frame) runs from ``start`` over the
    bytes of the identity that ``first`` names, the frame, and those that ``last`` names; ``end`` is
    XORed to the result. Identity bytes are "low", "high", "zero", "alternating" (low where the
    counter is even, else high) and "listed" (the entry of the list for the counter).
    """

    method: str
    byte: int
    polynomial: int = 0
    start: int = 0
    end: int = 0
    first: tuple[str, ...] = ()
    last: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Bytes it occupies in the frame."""
        return 2 if self.method == "crc16" else 1


@dataclass(frozen=True, slots=True)
class Counter:
    """A counter of ``values`` values, in ``width`` bits of one byte from ``bit`` up."""

    byte: int
    bit: int
    width: int
    values: int


@dataclass(frozen=True, slots=True)
class Protection:
    """Protection of the first ``length`` bytes of a frame.

    ``identity`` is the data id or constant, or 16 of them, one for each value of the counter;
    ``nibble`` the bit from which a frame carries bits 8 to 11 of its data id, or None. With
    ``resynchronises`` the receiver is that of profiles 1 and 2, else that of profiles 5 and 22.
    """

    profile: str
    length: int
    identity: int | tuple[int, ...]
    checksum: Checksum | None
    counter: Counter | None
    nibble: int | None = None

    @property
    def resynchronises(self) -> bool:
        """Whether the receiver resynchronises after lost or repeated frames."""
        few = self.counter is not None and self.counter.values < 256
        return few and self.profile in ("1", "2", "own")

    def apply(self, payload: bytearray, count: int) -> None:
        """Write counter ``count`` and checksum into a frame."""
        counter, checksum = self.counter, self.checksum
        if counter is not None:
            most = (1 << counter.width) - 1
            count &= most
            kept = payload[counter.byte] & ~(most << counter.bit)
            payload[counter.byte] = kept | count << counter.bit
        if self.nibble is not None:
            assert isinstance(self.identity, int)
            byte, bit = divmod(self.nibble, 8)
            payload[byte] = payload[byte] & ~(15 << bit) | (self.identity >> 8 & 15) << bit
        if checksum is not None:
            value = self.value(payload, count)
            payload[checksum.byte : checksum.byte + checksum.size] = value.to_bytes(
                checksum.size, "little"
            )

    def value(self, payload: bytes | bytearray, count: int) -> int:
        """The checksum of a frame that has its counter."""
        assert self.checksum is not None
        its = self.checksum
        own = range(its.byte, its.byte + its.size)
        data = [self._identity(which, count) for which in its.first]
        data += [payload[k] for k in range(self.length) if k not in own]
        data += [self._identity(which, count) for which in its.last]
        value = its.start
        for byte in data:
            value = _step(its, value, byte)
        return value ^ its.end

    def _identity(self, which: str, count: int) -> int:
        if not isinstance(self.identity, int):
            return self.identity[count % len(self.identity)]
        high = which == "high" or (which == "alternating" and count % 2 == 1)
        return 0 if which == "zero" else self.identity >> (8 if high else 0) & 255

    def bits(self) -> dict[str, range]:
        """The bits it occupies, by owner."""
        found = {}
        if self.checksum is not None:
            start = 8 * self.checksum.byte
            found["checksum"] = range(start, start + 8 * self.checksum.size)
        if self.counter is not None:
            start = 8 * self.counter.byte + self.counter.bit
            found["counter"] = range(start, start + self.counter.width)
        if self.nibble is not None:
            found["data id"] = range(self.nibble, self.nibble + 4)
        return found


def _step(its: Checksum, value: int, byte: int) -> int:
    if its.method == "xor":
        return value ^ byte
    if its.method == "sum":
        return (value + byte) & 255
    return crc_step(value, byte, its.polynomial, 8 * its.size)


def crc_step(value: int, byte: int, polynomial: int, width: int) -> int:
    """Update a CRC of ``width`` bits with one byte, most significant bit first."""
    entry = crc_table(polynomial, width)[(value >> (width - 8)) ^ byte]
    return (value << 8) & ((1 << width) - 1) ^ entry


@cache
def crc_table(polynomial: int, width: int) -> tuple[int, ...]:
    """The 256-entry lookup table of a CRC of ``width`` bits."""
    table = []
    for first in range(256):
        value = first << (width - 8)
        for _ in range(8):
            value = (value << 1) ^ (polynomial | 1 << width if value >> (width - 1) else 0)
        table.append(value)
    return tuple(table)


def protection(
    message: Message, table: Mapping[str, Any] | None, mapped: Iterable[str], where: str
) -> Protection | None:
    """The protection of a frame: from ``table`` of the map, else from the DBC's attributes.

    ``mapped`` are the names of the signals in use. None where the frame carries no protection.

    Raises:
        CanrollError: a wrong entry, a position outside the frame, or one that a signal uses too.
    """
    if table is None:
        table = _attributes(message, where)
    given = dict(documents.table(table, f"{where} protection"))
    profile = _profile(given.pop("profile", None), where)
    if profile == "none":
        return None
    for key in given:
        if key not in KEYS[profile]:
            raise UnknownNameError(f"key of E2E profile {profile} in {where}", key, KEYS[profile])
    length, rest = divmod(_number(given, "data_length", 8 * message.length, where), 8)
    if rest or not 1 <= length <= message.length:
        raise CanrollError(
            f"{where}: E2E data_length {8 * length + rest} must be whole bytes of the "
            f"{message.length} that {message.name} has, in bits"
        )
    make = {"1": _profile_1, "2": _profile_2, "5": _profile_5, "22": _profile_22, "own": _own}
    found = make[profile](given, message, length, where)
    _refuse_overlap(found, message, frozenset(mapped), where)
    return found


def _attributes(message: Message, where: str) -> dict[str, Any]:
    """Protection by DBC attributes; a data id alone means profile 1, a data id of 0 none."""
    given: dict[str, Any] = {}
    attributes = message.dbc.attributes if message.dbc else {}
    for name, key in ATTRIBUTES.items():
        if name in attributes:
            value = attributes[name].value
            choices = getattr(attributes[name].definition, "choices", None)
            given[key] = choices[value] if choices and isinstance(value, int) else value
    if isinstance(given.get("data_id"), str):
        given["data_id"] = [_integer(part, where) for part in re.findall(r"\w+", given["data_id"])]
    if "profile" not in given:
        given = {**given, "profile": "1"} if given.get("data_id") else {"profile": "none"}
    elif _profile(given["profile"], where) == "none":
        given = {"profile": "none"}
    return given


def _integer(text: str, where: str) -> int:
    try:
        return int(text, 0)
    except ValueError as error:
        raise CanrollError(f"{where}: '{text}' in E2EDataIdList is not a number") from error


def _profile(value: object, where: str) -> str:
    word = str(value).casefold()
    digits = re.fullmatch(r"(?:e2e[ _]?)?(?:profile[ _]?|p)?0?(1|2|5|22)", word)
    name = digits[1] if digits else word
    if name not in KEYS:
        raise CanrollError(
            f"{where}: E2E profile {value!r} is not supported: choose from {', '.join(KEYS)}"
        )
    return name


def _number(given: Mapping[str, Any], key: str, default: int, where: str) -> int:
    value = given.get(key, default)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise CanrollError(f"{where}: {key} must be an integer of at least 0, not {value!r}")
    return value


def _data_id(given: Mapping[str, Any], where: str) -> int:
    if "data_id" not in given:
        raise CanrollError(f"{where}: this E2E profile needs data_id")
    value = _number(given, "data_id", 0, where)
    if value > 0xFFFF:
        raise CanrollError(f"{where}: data_id {value} must fit 16 bits")
    return value


def _data_ids(given: Mapping[str, Any], where: str) -> tuple[int, ...]:
    value = given.get("data_id")
    if not isinstance(value, list) or len(value) != 16 or not all(_is_byte(v) for v in value):
        raise CanrollError(f"{where}: data_id must be a list of 16 bytes, one per counter value")
    return tuple(value)


def _is_byte(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= 255


def _byte(given: Mapping[str, Any], key: str, size: int, length: int, where: str) -> int:
    """The byte at which ``size`` bytes start, from a bit offset; the first by default."""
    bit = _number(given, key, 0, where)
    if bit % 8 or bit // 8 + size > length:
        raise CanrollError(f"{where}: {key} {bit} must be a multiple of 8 inside {8 * length} bits")
    return bit // 8


def _nibble(given: Mapping[str, Any], key: str, default: int, length: int, where: str) -> int:
    bit = _number(given, key, default, where)
    if bit % 4 or bit + 4 > 8 * length:
        raise CanrollError(f"{where}: {key} {bit} must be a multiple of 4 inside {8 * length} bits")
    return bit


def _profile_1(given: Mapping[str, Any], message: Message, length: int, where: str) -> Protection:
    mode = str(given.get("data_id_mode", "both")).casefold()
    mode = {"alt": "alternating"}.get(mode, mode)
    if mode not in MODES:
        raise UnknownNameError(f"data_id_mode in {where}", mode, MODES)
    first = {"both": ("low", "high"), "nibble": ("low", "zero")}.get(mode, (mode,))
    counter = _nibble(given, "counter_offset", 8, length, where)
    if mode != "nibble" and "data_id_nibble_offset" in given:
        raise CanrollError(f"{where}: data_id_nibble_offset needs data_id_mode nibble")
    if mode == "nibble" and _data_id(given, where) > 0xFFF:
        raise CanrollError(f"{where}: data_id must fit 12 bits in data_id_mode nibble")
    return Protection(
        "1",
        length,
        _data_id(given, where),
        Checksum("crc8", _byte(given, "crc_offset", 1, length, where), J1850, first=first),
        Counter(counter // 8, counter % 8, 4, 15),
        _nibble(given, "data_id_nibble_offset", 12, length, where) if mode == "nibble" else None,
    )


def _listed(profile: str, at: int, ids: tuple[int, ...], length: int) -> Protection:
    checksum = Checksum("crc8", at, H2F, 255, 255, last=("listed",))
    return Protection(profile, length, ids, checksum, Counter(at + 1, 0, 4, 16))


def _profile_2(given: Mapping[str, Any], message: Message, length: int, where: str) -> Protection:
    return _listed("2", _byte(given, "offset", 2, length, where), _data_ids(given, where), length)


def _profile_22(given: Mapping[str, Any], message: Message, length: int, where: str) -> Protection:
    at = _byte(given, "offset", 2, length, where)
    return _listed("22", at, _data_ids(given, where), length)


def _profile_5(given: Mapping[str, Any], message: Message, length: int, where: str) -> Protection:
    at = _byte(given, "offset", 3, length, where)
    checksum = Checksum("crc16", at, CCITT, 0xFFFF, last=("low", "high"))
    return Protection("5", length, _data_id(given, where), checksum, Counter(at + 2, 0, 8, 256))


def _own(given: Mapping[str, Any], message: Message, length: int, where: str) -> Protection:
    checksum, identity = _own_checksum(given.get("checksum"), message, where)
    counter = _own_counter(given.get("counter"), message, where)
    if checksum is None and counter is None:
        raise CanrollError(f"{where}: protection 'own' needs a checksum, a counter or both")
    if isinstance(identity, tuple) and (counter is None or counter.values > len(identity)):
        raise CanrollError(
            f"{where}: a constant for each counter value needs a counter of up to 16"
        )
    for place in (checksum.byte if checksum else 0, counter.byte if counter else 0):
        if place >= length:
            raise CanrollError(f"{where}: checksum and counter must be inside {8 * length} bits")
    return Protection("own", length, identity, checksum, counter)


def _own_checksum(
    entry: object, message: Message, where: str
) -> tuple[Checksum | None, int | tuple[int, ...]]:
    if entry is None:
        return None, 0
    table = _table(
        entry,
        "checksum",
        ("signal", "byte", "method", "polynomial", "start", "end", "constant"),
        where,
    )
    method = str(table.get("method", ""))
    if method not in METHODS:
        raise UnknownNameError(f"checksum method in {where}", method, METHODS)
    if ("polynomial" in table) != (method == "crc8"):
        raise CanrollError(
            f"{where}: a polynomial is required by method crc8 and not allowed otherwise"
        )
    bits = _place(table, "byte", 8, message, where)
    if len(bits) != 8 or bits[0] % 8:
        raise CanrollError(f"{where}: the checksum must be exactly one byte")
    polynomial = _number(table, "polynomial", 0, where)
    start, end = _number(table, "start", 0, where), _number(table, "end", 0, where)
    if not all(_is_byte(value) for value in (polynomial, start, end)):
        raise CanrollError(f"{where}: polynomial, start and end of a checksum must fit 8 bits")
    constant = table.get("constant")
    if isinstance(constant, list):
        listed = _data_ids({"data_id": constant}, where)
        return Checksum(method, bits[0] // 8, polynomial, start, end, last=("listed",)), listed
    if constant is not None and not _is_byte(constant):
        raise CanrollError(f"{where}: constant must be a byte, or a list of 16")
    last = ("low",) if constant is not None else ()
    return Checksum(method, bits[0] // 8, polynomial, start, end, last=last), constant or 0


def _own_counter(entry: object, message: Message, where: str) -> Counter | None:
    if entry is None:
        return None
    table = _table(entry, "counter", ("signal", "bit", "width", "values"), where)
    bits = _place(table, "bit", _number(table, "width", 4, where), message, where)
    if not bits or bits[0] // 8 != bits[-1] // 8:
        raise CanrollError(f"{where}: the counter must be inside one byte")
    values = _number(table, "values", 1 << len(bits), where)
    if not 2 <= values <= 1 << len(bits):
        raise CanrollError(f"{where}: a counter of {len(bits)} bits cannot have {values} values")
    return Counter(bits[0] // 8, bits[0] % 8, len(bits), values)


def _table(entry: object, name: str, keys: tuple[str, ...], where: str) -> Mapping[str, Any]:
    table = documents.table(entry, f"{where}: {name}")
    for key in table:
        if key not in keys:
            raise UnknownNameError(f"key of {name} in {where}", key, keys)
    return table


def _place(
    table: Mapping[str, Any], key: str, width: int, message: Message, where: str
) -> list[int]:
    """The bits of a signal of the frame, or of the ``key`` of the table, ascending."""
    if ("signal" in table) == (key in table):
        raise CanrollError(f"{where}: give either signal or {key}")
    if "signal" not in table:
        start = _number(table, key, 0, where) * (8 if key == "byte" else 1)
        return list(range(start, start + width))
    known = {signal.name: signal for signal in message.signals}
    name = table["signal"]
    if not isinstance(name, str) or name not in known:
        raise UnknownNameError(f"signal of {message.name} in {where}", name, known)
    return sorted(bits_of(known[name]))


def _refuse_overlap(
    found: Protection, message: Message, mapped: frozenset[str], where: str
) -> None:
    """Refuse a signal in use that shares a bit, and any other that is only partly covered."""
    taken = found.bits()
    parts = list(taken.items())
    for i, (name, bits) in enumerate(parts):
        for other, more in parts[:i]:
            if set(bits) & set(more):
                raise CanrollError(f"{where}: {name} and {other} of the protection overlap")
    for signal in message.signals:
        its = set(bits_of(signal))
        for name, bits in taken.items():
            shared = its & set(bits)
            if shared and (signal.name in mapped or not its <= set(bits)):
                raise CanrollError(
                    f"{where}: the {name} of E2E profile {found.profile} overlaps the signal "
                    f"{signal.name} at bit {min(shared)}: set its position, or use profile none"
                )
