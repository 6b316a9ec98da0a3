"""The two records as bytes, as every C compiler for the targets lays them out.

Fields stand in the order of their table, each at a multiple of its size; padding is zero. The same
bytes are read on the host and on a Cortex-M (both little-endian, 32-bit integers at multiples of
four), so states can be compared byte for byte. The CRC is over these bytes on every machine; what
is programmed into a big-endian one has the bytes of each word in the opposite order.
"""

import zlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from canroll.errors import CanrollError, optional
from canroll.firmware.calibration import Calibration
from canroll.firmware.subset import fields

NUMPY = {"i32": "<i4", "u8": "u1"}
HIGHEST_ADDRESS = 1 << 32
WORD = 4


@cache
def dtype(record_class: type[Any]) -> np.dtype[Any]:
    """The structured type of a record class, with C's padding."""
    rows = [(field.name, NUMPY[field.kind], field.shape) for field in fields(record_class)]
    return np.dtype(rows, align=True)


@cache
def event(size: int) -> np.dtype[Any]:
    """One frame of up to ``size`` bytes: received before the tick, or sent in it."""
    return np.dtype(
        [("tick", "<i4"), ("message", "<i4"), ("length", "<i4"), ("payload", "u1", (size,))]
    )


@cache
def event_of(record_class: type[Any]) -> np.dtype[Any]:
    """The event type whose payload is as large as the larger mailbox of a state record."""
    places = {field.name: field.shape for field in fields(record_class)}
    return event(max(places["rx_payload"][-1], places["tx_payload"][-1]))


def image(record: Any, byte_order: str = "little") -> bytes:  # noqa: ANN401
    """The bytes of a record as the memory of a machine has them, "little"- or "big"-endian."""
    packed = np.zeros((), dtype(record.__class__))
    for name in packed.dtype.names or ():
        packed[name] = getattr(record, name)
    if byte_order == "big":
        packed = packed.astype(packed.dtype.newbyteorder(">"))
    return packed.tobytes()


def sealed(record: Calibration) -> Calibration:
    """Set the CRC-32 of the bytes before it, as a signed 32-bit number; return ``record``."""
    places: Mapping[str, Any] = dtype(Calibration).fields or {}
    checksum = zlib.crc32(image(record)[: int(places["crc"][1])])
    record.crc = checksum - (1 << 32) if checksum >> 31 else checksum
    return record


def fill(record: Any, data: bytes) -> None:  # noqa: ANN401
    """Set all fields of ``record`` from its bytes."""
    packed = np.frombuffer(data, dtype(record.__class__), 1)[0]
    for name in packed.dtype.names or ():
        setattr(record, name, packed[name].tolist())


def differences(record_class: type, one: bytes, other: bytes) -> list[str]:
    """Names of the fields in which two images differ."""
    a, b = (np.frombuffer(data, dtype(record_class), 1)[0] for data in (one, other))
    return [name for name in a.dtype.names or () if not np.array_equal(a[name], b[name])]


def elements(record: Any) -> dict[tuple[str, tuple[int, ...]], int]:  # noqa: ANN401
    """Every stored integer of a record, by field name and indices."""
    packed = np.frombuffer(image(record), dtype(record.__class__), 1)[0]
    return {
        (name, indices): int(value)
        for name in packed.dtype.names or ()
        for indices, value in np.ndenumerate(packed[name])
    }


def check_address(address: int) -> None:
    """Raise CanrollError for an unaligned address, or one too high for a whole calibration."""
    size = dtype(Calibration).itemsize
    if address % WORD or not 0 <= address <= HIGHEST_ADDRESS - size:
        raise CanrollError(
            f"--address {address:#x} must be a multiple of {WORD} with room for {size} bytes"
        )


def write_flash(
    folder: Path, record: Calibration, address: int, byte_order: str = "little"
) -> list[Path]:
    """Write a calibration for a flash programmer: ``calibration.hex`` (Intel) and ``.s19``.

    Args:
        folder: where the files go.
        record: the calibration.
        address: of the calibration in the target.
        byte_order: of the target, "little" or "big".

    Returns:
        Both paths.

    Raises:
        CanrollError: as for :func:`check_address`, or bincopy is missing.
    """
    check_address(address)
    file = optional("bincopy", "a calibration for a programmer", "target").BinFile()
    file.add_binary(image(record, byte_order), address)
    written = []
    for name, text in (("calibration.hex", file.as_ihex()), ("calibration.s19", file.as_srec())):
        path = folder / name
        path.write_text(text, encoding="ascii")
        written.append(path)
    return written
