"""Memory footprint of the firmware, from the symbols of a linked image.

It also proves that neither heap nor floating point is needed: no symbol of either is linked.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from elftools.elf.elffile import ELFFile

from canroll.codegen.run import memory_image
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import Ecu

HEAP = ("malloc", "free", "calloc", "realloc", "sbrk", "_sbrk")
FLOAT = re.compile(r"__aeabi_(f|d|h|c[fd]|[iu]l?2[fd]|[ul]+2[fd])(?!iv0$|ivmod$)|__\w+[sd]f[23]?$")
"""Helpers that compilers call for float and double."""
BOARD = ("board_", "replay_", "main", "open_file", "transfer", "ecu", "calibration", "canroll_idle")


@dataclass(frozen=True, slots=True)
class Footprint:
    """Bytes of code, constant tables and records; names of forbidden symbols that are linked.

    ``text`` holds the firmware's functions and the compiler's helpers they call, without the
    start-up; ``static`` is memory beyond the caller's records (expected 0).
    """

    text: int
    tables: int
    static: int
    state: int
    calibration: int
    forbidden: tuple[str, ...]


def footprint(image: Path, state: type = Ecu) -> Footprint:
    """Read an ELF image with its symbol table; ``state`` is the class of its state record."""
    text = tables = static = 0
    forbidden = []
    with image.open("rb") as file:
        elf = ELFFile(file)
        writable = {
            i
            for i, section in enumerate(elf.iter_sections())
            if section["sh_flags"] & 1 and section["sh_flags"] & 2
        }
        seen = set()
        for symbol in elf.get_section_by_name(".symtab").iter_symbols():
            name, kind = symbol.name, symbol["st_info"]["type"]
            if name in HEAP or FLOAT.match(name):
                forbidden.append(name)
            place = (symbol["st_value"], kind)
            if kind not in ("STT_FUNC", "STT_OBJECT") or place in seen:
                continue
            seen.add(place)
            if name.startswith(BOARD):
                continue
            if kind == "STT_FUNC":
                text += symbol["st_size"]
            elif symbol["st_shndx"] in writable:
                static += symbol["st_size"]
            else:
                tables += symbol["st_size"]
    return Footprint(
        text,
        tables,
        static,
        memory_image.dtype(state).itemsize,
        memory_image.dtype(Calibration).itemsize,
        tuple(sorted(set(forbidden))),
    )
