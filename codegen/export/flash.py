"""A calibration for a programmer: Intel HEX and S-record, at the address it is to have."""

from pathlib import Path

from canroll.errors import CanrollError
from codegen.run import memory_image
from firmware.calibration import Calibration

HIGHEST = 1 << 32
WORD = 4


def write(folder: Path, record: Calibration, address: int) -> list[Path]:
    """Write ``calibration.hex`` and ``calibration.s19`` to ``folder``; return both.

    Raises:
        CanrollError: an address that no word has, or bincopy is missing.
    """
    data = memory_image.image(record)
    if address % WORD or not 0 <= address <= HIGHEST - len(data):
        raise CanrollError(
            f"--address {address:#x} must be a multiple of {WORD} with room for {len(data)} bytes"
        )
    try:
        from bincopy import BinFile  # noqa: PLC0415
    except ImportError as error:
        raise CanrollError(
            "a calibration for a programmer needs bincopy: .venv/bin/pip install -e '.[target]'"
        ) from error
    file = BinFile()
    file.add_binary(data, address)
    written = []
    for name, text in (("calibration.hex", file.as_ihex()), ("calibration.s19", file.as_srec())):
        path = folder / name
        path.write_text(text, encoding="ascii")
        written.append(path)
    return written
