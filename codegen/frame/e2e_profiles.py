"""Headers of AUTOSAR's E2E profiles (*E2E Protocol Specification*, PRS_E2EProtocol).

Profiles 1, 2, 5, 11 and 22 protect frames of any size, 4, 6 and 7 those of CAN FD: their headers
carry the length, and all but that of 6 the data id.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from canroll.codegen.frame.checksum import LISTED, Checksum
from canroll.codegen.frame.checksum_units import constant, frame_units, identity_units, listed
from canroll.codegen.frame.crc_kinds import CRCS
from canroll.codegen.frame.own_protection import number
from canroll.codegen.frame.place import Place, big, little
from canroll.errors import CanrollError, UnknownNameError

_OF_1 = ("data_id", "data_id_mode", "crc_offset", "counter_offset", "data_id_nibble_offset")
KEYS = {
    "1": _OF_1,
    "2": ("data_id",),
    "4": ("data_id", "offset"),
    "5": ("data_id", "offset"),
    "6": ("data_id", "offset"),
    "7": ("data_id", "offset"),
    "11": _OF_1,
    "22": ("data_id", "offset"),
}
MODES = {"1": ("both", "alternating", "low", "nibble"), "11": ("both", "nibble")}


class Header(NamedTuple):
    """What a profile puts into a frame.

    ``carried`` has for each further field its name, its place and its value, or None and the bit
    of the data id from which it has the bits.
    """

    data_id: int
    checksum: Checksum
    counter: Place
    values: int
    carried: tuple[tuple[str, Place, int | None, int], ...] = ()


def _data_id(given: Mapping[str, Any], bits: int, where: str) -> int:
    if "data_id" not in given:
        raise CanrollError(f"{where}: this E2E profile needs data_id")
    value = number(given, "data_id", 0, where)
    if value >> bits:
        raise CanrollError(f"{where}: data_id {value} must fit {bits} bits")
    return value


def _data_ids(given: Mapping[str, Any], where: str) -> tuple[int, ...]:
    value = given.get("data_id")
    if not isinstance(value, list) or len(value) != LISTED or not all(_is_byte(v) for v in value):
        raise CanrollError(f"{where}: data_id must be a list of 16 bytes, one per counter value")
    return tuple(value)


def _is_byte(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= 255


def _byte(given: Mapping[str, Any], key: str, size: int, length: int, where: str) -> int:
    """The byte at which ``size`` bytes start, from a bit offset; the first by default."""
    bit = number(given, key, 0, where)
    if size > length:
        raise CanrollError(f"{where}: a header of {size} bytes does not fit the {length} protected")
    if bit % 8 or bit // 8 + size > length:
        raise CanrollError(f"{where}: {key} {bit} must be a multiple of 8 inside {8 * length} bits")
    return bit // 8


def _nibble(given: Mapping[str, Any], key: str, default: int, length: int, where: str) -> Place:
    bit = number(given, key, default, where)
    if bit % 4 or bit + 4 > 8 * length:
        raise CanrollError(f"{where}: {key} {bit} must be a multiple of 4 inside {8 * length} bits")
    return little(bit, 4)


def _crc(name: str, place: Place, **parts: Any) -> Checksum:  # noqa: ANN401
    """One of AUTOSAR's CRCs."""
    kind = CRCS[name]
    parts = {"start": kind.start, "end": kind.end, **parts}
    return Checksum(
        place,
        "crc",
        polynomial=kind.polynomial,
        reflect_in=kind.reflected,
        reflect_out=kind.reflected,
        **parts,
    )


def _with_nibble(profile: str) -> Callable[[Mapping[str, Any], int, str], Header]:
    """Profiles 1 and 11: one byte, a counter of four bits, and maybe four of the data id."""

    def make(given: Mapping[str, Any], length: int, where: str) -> Header:
        mode = str(given.get("data_id_mode", "both")).casefold()
        mode = {"alt": "alternating"}.get(mode, mode)
        if mode not in MODES[profile]:
            raise UnknownNameError(f"data_id_mode in {where}", mode, MODES[profile])
        if mode != "nibble" and "data_id_nibble_offset" in given:
            raise CanrollError(f"{where}: data_id_nibble_offset needs data_id_mode nibble")
        data_id = _data_id(given, 16, where)
        if mode == "nibble" and data_id > 0xFFF:
            raise CanrollError(f"{where}: data_id must fit 12 bits in data_id_mode nibble")
        low, high = identity_units(2)
        identity = {
            "both": (low, high),
            "alternating": (listed((data_id & 255, data_id >> 8) * (LISTED // 2)),),
            "low": (low,),
            "nibble": (low, constant(0)),
        }[mode]
        place = little(8 * _byte(given, "crc_offset", 1, length, where), 8)
        units = (*identity, *frame_units(place, length))
        carried: tuple[tuple[str, Place, int | None, int], ...] = ()
        if mode == "nibble":
            nibble = _nibble(given, "data_id_nibble_offset", 12, length, where)
            carried = (("data id", nibble, None, 8),)
        return Header(
            data_id,
            # both profiles undo the start and the end of the CRC
            _crc("crc8_j1850", place, units=units, start=0, end=0),
            _nibble(given, "counter_offset", 8, length, where),
            15,
            carried,
        )

    return make


def _of_list(given: Mapping[str, Any], length: int, where: str) -> Header:
    """Profiles 2 and 22: one byte, a counter of four bits that selects the data id."""
    at = _byte(given, "offset", 2, length, where)
    place = little(8 * at, 8)
    units = (*frame_units(place, length), listed(_data_ids(given, where)))
    return Header(0, _crc("crc8_h2f", place, units=units), little(8 * at + 8, 4), 16)


def _profile_4(given: Mapping[str, Any], length: int, where: str) -> Header:
    at = _byte(given, "offset", 12, length, where)
    place = big(at + 8, 32)
    return Header(
        _data_id(given, 32, where),
        _crc("crc32_p4", place, units=frame_units(place, length)),
        big(at + 2, 16),
        1 << 16,
        (("length", big(at, 16), length, 0), ("data id", big(at + 4, 32), None, 0)),
    )


def _profile_5(given: Mapping[str, Any], length: int, where: str) -> Header:
    at = _byte(given, "offset", 3, length, where)
    place = little(8 * at, 16)
    units = (*frame_units(place, length), *identity_units(2))
    checksum = _crc("crc16_ccitt", place, units=units)
    return Header(_data_id(given, 16, where), checksum, little(8 * at + 16, 8), 256)


def _profile_6(given: Mapping[str, Any], length: int, where: str) -> Header:
    at = _byte(given, "offset", 5, length, where)
    place = big(at, 16)
    units = (*frame_units(place, length), *reversed(identity_units(2)))
    return Header(
        _data_id(given, 16, where),
        _crc("crc16_ccitt", place, units=units),
        little(8 * at + 32, 8),
        256,
        (("length", big(at + 2, 16), length, 0),),
    )


def _profile_7(given: Mapping[str, Any], length: int, where: str) -> Header:
    at = _byte(given, "offset", 20, length, where)
    place = big(at, 64)
    return Header(
        _data_id(given, 32, where),
        _crc("crc64", place, units=frame_units(place, length)),
        big(at + 12, 32),
        1 << 32,
        (("length", big(at + 8, 32), length, 0), ("data id", big(at + 16, 32), None, 0)),
    )


PROFILES: Mapping[str, Callable[[Mapping[str, Any], int, str], Header]] = {
    "1": _with_nibble("1"),
    "2": _of_list,
    "4": _profile_4,
    "5": _profile_5,
    "6": _profile_6,
    "7": _profile_7,
    "11": _with_nibble("11"),
    "22": _of_list,
}
