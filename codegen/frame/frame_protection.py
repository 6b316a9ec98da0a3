"""End-to-end protection of one frame: checksum, counter, and what else its header carries.

AUTOSAR E2E profiles 1, 2, 4, 5, 6, 7, 11 and 22 (:mod:`canroll.codegen.frame.e2e_profiles`) and
what manufacturers made themselves (:mod:`canroll.codegen.frame.own_protection`). A protection comes
from the DBC's attributes or from the map (:func:`protection`); :meth:`Protection.apply` defines it.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cantools.database.can import Message

from canroll import documents
from canroll.codegen.frame.checksum import Checksum
from canroll.codegen.frame.e2e_profiles import KEYS as OF_PROFILES
from canroll.codegen.frame.e2e_profiles import PROFILES, Header
from canroll.codegen.frame.own_protection import HELD_BITS, number, own_checksum_of, own_counter
from canroll.codegen.frame.place import Place
from canroll.codegen.frame.raw_signal import bits_of
from canroll.errors import CanrollError

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
    **{name: (*keys, "data_length") for name, keys in OF_PROFILES.items()},
    "own": ("checksum", "counter", "data_length"),
}
RESYNCHRONISED = ("1", "2", "own")
"""Profiles with the receiver of E2E_P01Check, where a counter has few values."""


@dataclass(frozen=True, slots=True)
class Counter:
    """A counter of ``values`` values in its place, of which those held are counted."""

    place: Place
    values: int

    @property
    def held(self) -> Place:
        """The bits of it that are counted."""
        return self.place.low(HELD_BITS)

    def read(self, payload: Sequence[int]) -> int:
        """The counter in a frame."""
        return self.held.read(payload)


@dataclass(frozen=True, slots=True)
class Carried:
    """A number that every frame of a protection has: ``value``, or bits of its identity.

    Attributes:
        name: what it is, for messages.
        place: where it stands.
        value: its value, None: bits of the identity from ``shift`` up.
        shift: see ``value``.
    """

    name: str
    place: Place
    value: int | None = None
    shift: int = 0

    def of(self, identity: int) -> int:
        """Its value in frames with an identity."""
        return identity >> self.shift if self.value is None else self.value


@dataclass(frozen=True, slots=True)
class Protection:
    """Protection of the first ``length`` bytes of a frame.

    ``identity`` is the data id, or the frame's identifier where a manufacturer made the protection.
    With ``resynchronises`` the receiver is that of profiles 1 and 2, else that of the others.
    """

    profile: str
    length: int
    identity: int
    checksum: Checksum | None
    counter: Counter | None
    carried: tuple[Carried, ...] = ()

    @property
    def resynchronises(self) -> bool:
        """Whether the receiver resynchronises after lost or repeated frames."""
        few = self.counter is not None and self.counter.values < 256
        return few and self.profile in RESYNCHRONISED

    @property
    def identified(self) -> bool:
        """Whether it differs with the identity of the frame."""
        used = self.checksum is not None and self.checksum.identified
        return used or any(field.value is None for field in self.carried)

    def apply(self, payload: bytearray, count: int) -> None:
        """Write counter ``count``, checksum and all else of the protection into a frame."""
        if self.counter is not None:
            self.counter.place.write(payload, count & (1 << self.counter.held.width) - 1)
        for field in self.carried:
            field.place.write(payload, field.of(self.identity))
        if self.checksum is not None:
            self.checksum.place.write(payload, self.value(payload, count))

    def holds(self, payload: bytes) -> bool:
        """Whether all of the protection in a frame but its counter is right."""
        checksum = self.checksum
        wanted = [(field.place, field.of(self.identity)) for field in self.carried]
        if checksum is not None:
            count = self.counter.read(payload) if self.counter else 0
            wanted.append((checksum.place, self.value(payload, count)))
        return all(place.read(payload) == value & (1 << place.width) - 1 for place, value in wanted)

    def value(self, payload: bytes | bytearray, count: int) -> int:
        """The checksum of a frame that has its counter."""
        assert self.checksum is not None
        return self.checksum.value(payload, self.identity, count)

    def bits(self) -> dict[str, tuple[int, ...]]:
        """The bits it occupies, by owner."""
        found = {field.name: field.place.bits for field in self.carried}
        if self.checksum is not None:
            found["checksum"] = self.checksum.place.bits
        if self.counter is not None:
            found["counter"] = self.counter.place.bits
        return found


def protection(
    message: Message,
    table: Mapping[str, Any] | None,
    mapped: Iterable[str],
    where: str,
    folder: Path = Path(),
) -> Protection | None:
    """The protection of a frame: from ``table`` of the map, else from the DBC's attributes.

    ``mapped`` are the names of the signals in use; files that the table names are relative to
    ``folder``. None where the frame carries no protection.

    Raises:
        CanrollError: a wrong entry, a position outside the frame, or one that a signal uses too.
    """
    if table is None:
        table = _attributes(message, where)
    given = dict(documents.table(table, f"{where} protection"))
    profile = _profile(given.pop("profile", None), where)
    if profile == "none":
        return None
    documents.refuse_unknown(given, KEYS[profile], f"key of E2E profile {profile} in {where}")
    length, rest = divmod(number(given, "data_length", 8 * message.length, where), 8)
    if rest or not 1 <= length <= message.length:
        raise CanrollError(
            f"{where}: E2E data_length {8 * length + rest} must be whole bytes of the "
            f"{message.length} that {message.name} has, in bits"
        )
    if profile == "own":
        found = _own(given, message, length, where, folder)
    else:
        found = _of_header(profile, PROFILES[profile](given, length, where), length)
    _refuse_overlap(found, message, frozenset(mapped), where)
    return found


def _of_header(profile: str, header: Header, length: int) -> Protection:
    carried = tuple(Carried(*field) for field in header.carried)
    counter = _counter(header.counter, header.values)
    return Protection(profile, length, header.data_id, header.checksum, counter, carried)


def _counter(place: Place, values: int) -> Counter:
    return Counter(place, min(values, 1 << HELD_BITS))


def _own(
    given: Mapping[str, Any], message: Message, length: int, where: str, folder: Path
) -> Protection:
    counted = own_counter(given.get("counter"), message, where)
    counter = None if counted is None else _counter(*counted)
    place = counter.held if counter else None
    checksum = own_checksum_of(given.get("checksum"), message, length, place, where, folder)
    if checksum is None and counter is None:
        raise CanrollError(f"{where}: protection 'own' needs a checksum, a counter or both")
    return Protection("own", length, message.frame_id, checksum, counter)


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
    digits = re.fullmatch(r"(?:e2e[ _]?)?(?:profile[ _]?|p)?0?(\d+)", word)
    name = digits[1] if digits else word
    if name not in KEYS:
        raise CanrollError(
            f"{where}: E2E profile {value!r} is not supported: choose from {', '.join(KEYS)}"
        )
    return name


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
    protected = frozenset(bit for bits in taken.values() for bit in bits)
    for signal in message.signals:
        its = set(bits_of(signal))
        for name, bits in taken.items():
            shared = its & set(bits)
            if shared and (signal.name in mapped or not its <= protected):
                raise CanrollError(
                    f"{where}: the {name} of E2E profile {found.profile} overlaps the signal "
                    f"{signal.name} at bit {min(shared)}: set its position, or use profile none"
                )
