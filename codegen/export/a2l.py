"""An ASAP2 (A2L) description of both records, for calibration and measurement tools."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from codegen.c99.text import plain
from codegen.run import memory_image
from firmware.calibration import Calibration
from firmware.state import Ecu
from firmware.subset import Field, fields

TYPES = {"i32": "SLONG", "u8": "UBYTE"}
RECORDS = {"calibration": Calibration, "ecu": Ecu}


def addresses(elf: Path) -> dict[str, int]:
    """Addresses of the symbols ``ecu`` and ``calibration`` in a linked image."""
    from elftools.elf.elffile import ELFFile  # noqa: PLC0415

    with elf.open("rb") as file:
        table = ELFFile(file).get_section_by_name(".symtab")
        found = {}
        for name in RECORDS:
            symbols = table.get_symbol_by_name(name) if table else None
            if symbols:
                found[name] = int(symbols[0]["st_value"])
    return found


def a2l(base: Mapping[str, int] | None = None) -> str:
    """The file's text; ``base`` are the records' addresses, 0 where not known yet."""
    lines = [
        "ASAP2_VERSION 1 71",
        '/begin PROJECT canroll "roll controller"',
        '  /begin MODULE ecu "the records of the roll controller"',
        '    /begin MOD_COMMON ""',
        "      BYTE_ORDER MSB_LAST",
        "      ALIGNMENT_LONG 4",
        "    /end MOD_COMMON",
    ]
    for kind in sorted(set(TYPES.values())):
        lines += [
            f"    /begin RECORD_LAYOUT {kind}_VALUES",
            f"      FNC_VALUES 1 {kind} ROW_DIR DIRECT",
            f"    /end RECORD_LAYOUT {kind}_VALUES",
        ]
    methods = {(field.f.q, field.f.unit) for record in RECORDS.values() for field in fields(record)}
    for q, unit in sorted(methods):
        lines += [
            f'    /begin COMPU_METHOD {_method(q, unit)} "n / 2^{q}"',
            f'      RAT_FUNC "%.9g" "{plain(unit)}"',
            f"      COEFFS 0 {2**q} 0 0 0 1",
            f"    /end COMPU_METHOD {_method(q, unit)}",
        ]
    for name, record in RECORDS.items():
        offsets: Mapping[str, Any] = memory_image.dtype(record).fields or {}
        for field in fields(record):
            offset = int(offsets[field.name][1])
            address = (base or {}).get(name, 0) + offset
            lines += _entry(name, field, address, offset)
    return "\n".join([*lines, "  /end MODULE", "/end PROJECT", ""])


def _entry(record: str, field: Field, address: int, offset: int) -> Iterator[str]:
    scale = 2.0**field.f.q
    limits = f"{field.f.lo / scale:.9g} {field.f.hi / scale:.9g}"
    method = _method(field.f.q, field.f.unit)
    name, text = f"{record}.{field.name}", plain(field.f.meaning).replace('"', "'")
    kind = TYPES[field.kind]
    sizes = " ".join(str(n) for n in reversed(field.shape))
    if record == "calibration":
        what = "VAL_BLK" if field.shape else "VALUE"
        yield f'    /begin CHARACTERISTIC {name} "{text}"'
        yield f"      {what} 0x{address:08X} {kind}_VALUES 0 {method} {limits}"
        if field.shape:
            yield f"      MATRIX_DIM {sizes}"
        yield f'      SYMBOL_LINK "{record}" {offset}'
        yield "    /end CHARACTERISTIC"
        return
    yield f'    /begin MEASUREMENT {name} "{text}"'
    yield f"      {kind} {method} 0 0 {limits}"
    yield f"      ECU_ADDRESS 0x{address:08X}"
    if field.shape:
        yield f"      MATRIX_DIM {sizes}"
    yield f'      SYMBOL_LINK "{record}" {offset}'
    yield "    /end MEASUREMENT"


def _method(q: int, unit: str) -> str:
    word = "".join(c if c.isascii() and c.isalnum() else "_" for c in plain(unit)) or "one"
    return f"Q{q}_{word}"
