"""An ASAP2 (A2L) description of both records, for calibration and measurement tools.

ASAP2 1.71 (ASAM MCD-2 MC): the calibration as characteristics, the schedule as curves over speed,
the ECU's state as measurements, groups as in the sources, value tables, EPK and CRC, and XCP on CAN
where the bus has identifiers for it.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from elftools.elf.elffile import ELFFile

from canroll.codegen.c99.text import plain
from canroll.codegen.export import a2l_xcp
from canroll.codegen.generated.bus_map import XcpFrames
from canroll.codegen.run import memory_image
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import Program
from canroll.errors import CanrollError, reason
from canroll.firmware.calibration import N_POINTS, Calibration
from canroll.firmware.state import Ecu
from canroll.firmware.subset import Field, fields

TYPES = {"i32": "SLONG", "u8": "UBYTE"}
RECORDS = {"calibration": Calibration, "ecu": Ecu}
EPK_SYMBOL = "canroll_epk"
SYMBOLS = (*RECORDS, EPK_SYMBOL)
BYTE_ORDERS = {"little": "MSB_LAST", "big": "MSB_FIRST"}
AXIS = "schedule_speed"
CURVES = ("schedule_gain", "schedule_front_share", "schedule_steering")
CODE = re.compile(r"(\d+):? ([A-Za-z][^,\d]*?)(?=,| \d|$)")


@dataclass(frozen=True, slots=True)
class Image:
    """A linked image: addresses of those :data:`SYMBOLS` that it has, and its byte order."""

    addresses: Mapping[str, int]
    byte_order: str


@dataclass(frozen=True, slots=True)
class Software:
    """The described software: its EPK, its calibration, and XCP where the bus has it.

    ``state`` is the class of the firmware's state record, ``program`` the firmware as data, by
    default that of the package; ``calibrated`` is whether the calibration can be tuned: specialised
    code has it compiled in. ``slave``: the XCP slave where it is in the firmware, which reads the
    two records alone and not the EPK.
    """

    epk: str
    record: Calibration
    xcp: XcpFrames | None = None
    state: type[Any] = Ecu
    program: Program | None = None
    calibrated: bool = True
    slave: a2l_xcp.Slave | None = None

    @property
    def records(self) -> dict[str, Any]:
        """The described records, by their symbols."""
        every: dict[str, Any] = RECORDS | {"ecu": self.state}
        return every if self.calibrated else {"ecu": self.state}


def addresses(elf: Path) -> Mapping[str, int]:
    """Addresses of those :data:`SYMBOLS` that a linked image has; errors as :func:`image`."""
    return image(elf).addresses


def image(elf: Path) -> Image:
    """What a linked image says of its records.

    Raises:
        CanrollError: it cannot be read, or is no ELF file.
    """
    found = {}
    try:
        with elf.open("rb") as file:
            its = ELFFile(file)
            order = "little" if its.little_endian else "big"
            table = its.get_section_by_name(".symtab")
            for name in SYMBOLS:
                symbols = table.get_symbol_by_name(name) if table else None
                if symbols:
                    found[name] = int(symbols[0]["st_value"])
    except Exception as error:  # pyelftools lets through whatever its parsers raise
        raise CanrollError(f"{elf}: not a readable ELF file: {reason(error)}") from error
    return Image(found, order)


def a2l(
    software: Software, base: Mapping[str, int] | None = None, byte_order: str = "little"
) -> str:
    """The file's text; ``base`` holds addresses of :data:`SYMBOLS`, 0 where not known yet.

    ``byte_order``, "little" or "big", is that of the target's memory. The numbers in XCP commands
    are little-endian on every target.
    """
    lines = [
        "ASAP2_VERSION 1 71",
        '/begin PROJECT canroll "roll controller"',
        '  /begin MODULE ecu "the records of the roll controller"',
    ]
    lines += [a2l_xcp.A2ML] if software.xcp else []
    lines += _parameters(software)
    lines += [
        '    /begin MOD_COMMON ""',
        f"      BYTE_ORDER {BYTE_ORDERS[byte_order]}",
        "      ALIGNMENT_BYTE 1",
        "      ALIGNMENT_LONG 4",
        "    /end MOD_COMMON",
    ]
    if software.xcp:
        lines += a2l_xcp.interface(software.xcp, software.slave)
    for kind in sorted(set(TYPES.values())):
        lines += _block("RECORD_LAYOUT", f"{kind}_VALUES", [f"FNC_VALUES 1 {kind} ROW_DIR DIRECT"])
    lines += _block("RECORD_LAYOUT", "SLONG_AXIS", ["AXIS_PTS_X 1 SLONG INDEX_INCR DIRECT"])
    lines += _methods(software)
    for name, record in software.records.items():
        offsets: Mapping[str, Any] = memory_image.dtype(record).fields or {}
        for field in fields(record):
            lines += _entry(name, field, int(offsets[field.name][1]))
    lines += _groups(software, software.program or load())
    text = "\n".join([*lines, "  /end MODULE", "/end PROJECT", ""])
    return located(text, base or {})


def ordered(text: str, byte_order: str) -> str:
    """An A2L text of ours for memory of another byte order, "little" or "big"."""
    return re.sub(
        r"^( +BYTE_ORDER) MSB_\w+$", rf"\1 {BYTE_ORDERS[byte_order]}", text, flags=re.MULTILINE
    )


def located(text: str, base: Mapping[str, int]) -> str:
    """An A2L text of ours with the addresses of ``base`` filled in by its symbol links."""

    def moved(match: re.Match[str]) -> str:
        symbol, offset = match["symbol"], int(match["offset"] or 0)
        if symbol not in base:
            return match[0]
        return match[0].replace(match["address"], f"0x{base[symbol] + offset:08X}", 1)

    text = re.sub(
        r"/begin (?P<kind>CHARACTERISTIC|MEASUREMENT|AXIS_PTS) (?:(?!/end).)*?"
        r"(?P<address>0x[0-9A-F]{8})(?:(?!/end (?P=kind)).)*?"
        r'SYMBOL_LINK "(?P<symbol>\w+)" (?P<offset>\d+)',
        moved,
        text,
        flags=re.DOTALL,
    )
    for line, symbol in (("ADDR_EPK", EPK_SYMBOL), ("DATA FLASH INTERN", "calibration")):
        if symbol in base:
            text = re.sub(rf"{line} 0x[0-9A-F]{{8}}", f"{line} 0x{base[symbol]:08X}", text)
    return text


def enumeration(field: Field) -> dict[int, str]:
    """The names of a field's values, where its meaning gives them all; 0 and 1 are no and yes."""
    codes = {int(code): name for code, name in CODE.findall(field.f.meaning)}
    if field.f.q or field.f.unit or field.f.lo != 0 or field.f.hi > 15:
        return {}
    if set(codes) == set(range(field.f.hi + 1)):
        return codes
    return {0: "no", 1: "yes"} if field.f.hi == 1 else {}


def _block(kind: str, head: str, lines: list[str]) -> Iterator[str]:
    yield f"    /begin {kind} {head}"
    yield from (f"      {line}" for line in lines)
    yield f"    /end {kind}"


def _parameters(software: Software) -> Iterator[str]:
    record = software.record
    size = memory_image.dtype(Calibration).itemsize
    pages = f"{software.slave.segment} " if software.slave else ""
    segment = [
        '/begin MEMORY_SEGMENT calibration "the calibration" '
        f"DATA FLASH INTERN 0x00000000 0x{size:X} -1 -1 -1 -1 -1 {pages}/end MEMORY_SEGMENT"
    ]
    yield from _block(
        "MOD_PAR",
        f'"{_text(software.epk)}"',
        [
            f'VERSION "{_text(software.epk)}"',
            *([] if software.slave else ["ADDR_EPK 0x00000000"]),
            f'EPK "{_text(software.epk)}"',
            *(segment if software.calibrated else []),
            f'SYSTEM_CONSTANT "CALIBRATION_ID" "0x{record.id:08X}"',
            f'SYSTEM_CONSTANT "CALIBRATION_CRC" "0x{record.crc & 0xFFFFFFFF:08X}"',
        ],
    )


def _methods(software: Software) -> Iterator[str]:
    seen = set()
    for record, its in software.records.items():
        for field in fields(its):
            name = _method(record, field)
            if name in seen:
                continue
            seen.add(name)
            codes, unit = enumeration(field), f'"{plain(field.f.unit)}"'
            if codes:
                table = f"{name}_table"
                texts = [f'{code} "{_text(text)}"' for code, text in sorted(codes.items())]
                yield from _block(
                    "COMPU_METHOD",
                    f'{name} ""',
                    [f'TAB_VERB "%s" {unit}', f"COMPU_TAB_REF {table}"],
                )
                yield from _block("COMPU_VTAB", f'{table} "" TAB_VERB {len(codes)}', texts)
            elif field.f.q:
                yield from _block(
                    "COMPU_METHOD",
                    f'{name} "n / 2^{field.f.q}"',
                    [f'RAT_FUNC "%14.9" {unit}', f"COEFFS 0 {2**field.f.q} 0 0 0 1"],
                )
            else:
                yield from _block("COMPU_METHOD", f'{name} ""', [f'IDENTICAL "%10.0" {unit}'])


def _method(record: str, field: Field) -> str:
    codes = enumeration(field)
    if set(codes.values()) == {"no", "yes"}:
        return "yes_no"
    if codes:
        return f"{record}_{field.name}_values"
    word = "".join(c if c.isascii() and c.isalnum() else "_" for c in plain(field.f.unit)) or "one"
    return f"Q{field.f.q}_{word}"


def _number(n: int, q: int) -> str:
    """``n`` / 2**``q``, exactly: a limit must not leave its type by rounding."""
    return str(n) if q == 0 else repr(n / 2**q)


def _entry(record: str, field: Field, offset: int) -> Iterator[str]:
    limits = f"{_number(field.f.lo, field.f.q)} {_number(field.f.hi, field.f.q)}"
    name, method, kind = f"{record}.{field.name}", _method(record, field), TYPES[field.kind]
    head = f'{name} "{_text(field.f.meaning)}"'
    sizes = [*reversed(field.shape), 1, 1, 1][:3]
    dimensions = [f"MATRIX_DIM {' '.join(str(n) for n in sizes)}"] if field.shape else []
    link = f'SYMBOL_LINK "{record}" {offset}'
    address = f"0x{offset:08X}"
    if record == "ecu":
        lines = [f"{kind} {method} 0 0 {limits}", f"ECU_ADDRESS {address}", *dimensions, link]
        yield from _block("MEASUREMENT", head, lines)
    elif field.name == AXIS:
        lines = [f"{address} ecu.speed SLONG_AXIS 0 {method} {N_POINTS} {limits}", link]
        yield from _block("AXIS_PTS", head, lines)
    elif field.name in CURVES:
        axis = next(its for its in fields(Calibration) if its.name == AXIS)
        ends = f"{_number(axis.f.lo, axis.f.q)} {_number(axis.f.hi, axis.f.q)}"
        lines = [
            f"CURVE {address} {kind}_VALUES 0 {method} {limits}",
            f"/begin AXIS_DESCR COM_AXIS ecu.speed {_method(record, axis)} {N_POINTS} {ends} "
            f"AXIS_PTS_REF {record}.{AXIS} /end AXIS_DESCR",
            link,
        ]
        yield from _block("CHARACTERISTIC", head, lines)
    else:
        what = "VAL_BLK" if field.shape else "VALUE"
        only = ["READ_ONLY"] if field.name in ("crc", "id", "layout", "version") else []
        lines = [f"{what} {address} {kind}_VALUES 0 {method} {limits}", *dimensions, *only, link]
        yield from _block("CHARACTERISTIC", head, lines)


def _groups(software: Software, program: Program) -> Iterator[str]:
    """The groups of the records as their sources have them, by the comments above the fields."""
    for name, record_class in software.records.items():
        record = program.record(record_class.__name__)
        comments = program.modules[record.module].comments
        groups: dict[str, list[str]] = {}
        title, last = "general", record.line
        for its in record.fields.values():
            for line in range(last + 1, its.line):
                own, text = comments.get(line, (False, ""))
                if own and not comments.get(line - 1, (False, ""))[0]:
                    title = re.split(r"[:;,]", text)[0]
            last = its.line
            groups.setdefault(title, []).append(f"{name}.{its.name}")
        names = [f"{name}_{re.sub(r'[^A-Za-z0-9]+', '_', title)}" for title in groups]
        sub = f"/begin SUB_GROUP {' '.join(names)} /end SUB_GROUP"
        yield from _block("GROUP", f'{name} "{_text(record.doc.splitlines()[0])}"', ["ROOT", sub])
        reference = "REF_CHARACTERISTIC" if name == "calibration" else "REF_MEASUREMENT"
        for group, (title, members) in zip(names, groups.items(), strict=True):
            # an axis is no characteristic
            listed = [f"  {each}" for each in members if each != f"calibration.{AXIS}"]
            lines = [f"/begin {reference}", *listed, f"/end {reference}"]
            yield from _block("GROUP", f'{group} "{_text(title)}"', lines)


def _text(text: str) -> str:
    return plain(text).replace('"', "'").replace("\\", "/")
