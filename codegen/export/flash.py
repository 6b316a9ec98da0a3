"""A calibration for a flash programmer: Intel HEX and S-record at a given address."""

from pathlib import Path

from canroll.errors import CanrollError, optional
from codegen.run import memory_image
from firmware.calibration import Calibration

HIGHEST = 1 << 32
WORD = 4


def check(address: int) -> None:
    """Raise CanrollError for an unaligned address, or one too high for a whole calibration."""
    size = memory_image.dtype(Calibration).itemsize
    if address % WORD or not 0 <= address <= HIGHEST - size:
        raise CanrollError(
            f"--address {address:#x} must be a multiple of {WORD} with room for {size} bytes"
        )


def write(folder: Path, record: Calibration, address: int) -> list[Path]:
    """Write ``calibration.hex`` and ``calibration.s19`` to ``folder``; return both.

    Raises:
        CanrollError: as for :func:`check`, or bincopy is missing.
    """
    check(address)
    file = optional("bincopy", "a calibration for a programmer", "target").BinFile()
    file.add_binary(memory_image.image(record), address)
    written = []
    for name, text in (("calibration.hex", file.as_ihex()), ("calibration.s19", file.as_srec())):
        path = folder / name
        path.write_text(text, encoding="ascii")
        written.append(path)
    return written
