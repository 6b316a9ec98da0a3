"""The ECU's calibration record from plain values, sealed with id and CRC."""

import re
import zlib
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from typing import Any

from canroll.codegen.run.memory_image import sealed
from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration
from canroll.firmware.subset import fields

IDENTITY = "id"
RESERVED = "crc"


def fill(values: Mapping[str, Any]) -> Calibration:
    """Return a record with ``values``; other fields have their least value.

    Raises:
        CanrollError: a value is outside its field's range.
    """
    record = Calibration()
    table = {field.name: field for field in fields(Calibration)}
    for name, value in values.items():
        field = table[name]
        for item in flatten(value):
            if not field.f.lo <= item <= field.f.hi:
                unit = f" {field.f.unit}" if field.f.unit else ""
                raise CanrollError(
                    f"{name}: {item * 2.0**-field.f.q:.6g}{unit} is outside "
                    f"{field.f.lo * 2.0**-field.f.q:.6g} to {field.f.hi * 2.0**-field.f.q:.6g}"
                )
        setattr(record, name, copied(value))
    return record


def copied(value: Any) -> Any:  # noqa: ANN401
    """Return ``value`` with its lists copied: records must not share them."""
    return [copied(item) for item in value] if isinstance(value, list) else value


def flatten(value: Any) -> Iterator[int]:  # noqa: ANN401
    """Yield the integers of a scalar, list or list of lists in memory order."""
    if isinstance(value, list):
        for item in value:
            yield from flatten(item)
    else:
        yield value


def packed(record: Calibration) -> bytes:
    """Return the fields before the CRC, each value as four little-endian bytes."""
    return b"".join(
        (item & 0xFFFFFFFF).to_bytes(4, "little")
        for field in fields(Calibration)
        if field.name != RESERVED
        for item in flatten(getattr(record, field.name))
    )


def identify(record: Calibration) -> Calibration:
    """Set version, id (from the content) and CRC of the record; return ``record``."""
    record.version = [int(part) for part in re.findall(r"\d+", version("canroll"))[:3]]
    setattr(record, IDENTITY, 0)
    setattr(record, IDENTITY, zlib.crc32(b"canroll" + packed(record)) & 0x7FFFFFFF)
    return sealed(record)
