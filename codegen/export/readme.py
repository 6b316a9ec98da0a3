"""The README of a bundle."""

from collections.abc import Iterator
from pathlib import Path
from pkgutil import resolve_name

from canroll.codegen.export import (
    coverage_cases,
    figures,
    interrupts,
    misra,
    operation,
    traceability,
)
from canroll.codegen.export.contents import Code, Export
from canroll.codegen.export.sessions import secoc_session
from canroll.codegen.frame.frame_protection import Protection
from canroll.codegen.frame.place import Place
from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.generated.mailbox import EXTENDED
from canroll.codegen.run import memory_image
from canroll.codegen.run.service import SERVICES
from canroll.dbc.reader import each

TEMPLATES = Path(__file__).with_name("templates")
FD_NOTE = """ `canroll_signals_tx_fd[slot]` is 0
   for a classic frame, 1 for CAN FD, 3 for CAN FD with bit-rate switch. A frame of several
   mailboxes is given to `canroll_receive` once for each."""

SPECIALISED_NOTE = """
The code was specialised for the one calibration in `canroll_gains.h`: gains are literals, options
that are off are gone. The general code gives the same bytes, and the vectors are made by it. There
is nothing to tune: the A2L describes the ECU's record alone, a new calibration takes a new export.
`canroll_init` refuses every other record by its CRC (rule 511), and another `canroll_gains.h` does
not compile. The record stays in memory, as `canroll_tick` goes on checking that CRC.
"""
GENERAL_FILES = "the loop, one file a stage"
SPECIALISED_FILES = "the loop, in `canroll_ecu.c`"
GENERAL_CASES = """\
The cases in `test/session_cases.c` run other calibrations than yours, all laws, observers and
refusals among them, on hostile frames. They reach every statement and branch of the loop (`make
coverage` shows it with gcov) but these, which are of the frames of canroll's own bus:

{unreached}"""
SPECIALISED_CASES = """\
The cases in `test/session_cases.c` run the calibration on hostile frames, and give `canroll_init`
records that it refuses. `make coverage` counts with gcov what they reach."""
FLASHING_NOTE = """ With
`--calibration FILE` it also writes that calibration for the address of the one in your image, as
`calibration.hex` (Intel HEX) and `calibration.s19` (S-record); `--address` does where there is no
image."""


def text(export: Export, code: Code) -> str:
    """Return the README of a bundle."""
    firmware, served, bus = code.loop, code.served, code.loop.bus
    protection = (
        "Checksums and counters are as the table says."
        if bus.protected and export.record.e2e
        else "The frames carry no end-to-end protection (`calibration.e2e` is 0)."
    )
    page = (TEMPLATES / "README.md").read_text(encoding="utf-8")
    values = {
        "title": export.title,
        "kind": SPECIALISED_NOTE if export.specialised else "",
        "sources": SPECIALISED_FILES if export.specialised else GENERAL_FILES,
        "described": "the ECU's record" if export.specialised else "every field of both records",
        "flashing": "" if export.specialised else FLASHING_NOTE,
        "state": str(memory_image.dtype(firmware.record).itemsize),
        "tick_us": str(export.record.tick_us),
        "fd": FD_NOTE if any(box.fd for box in bus.transmitted) else "",
        "frames": "\n".join(_frames(bus)),
        "protection": protection,
        "dbc": "`, `".join(path.name for path in each(export.dbc)),
        "order": f"{export.byte_order}-endian",
        "vectors": export.origin,
        "deviations": misra.table(),
        "cases": SPECIALISED_CASES
        if export.specialised
        else GENERAL_CASES.format(unreached=coverage_cases.table()),
        "interrupts": interrupts.table(served.program()),
        "figures": figures.table(export.record, firmware, served)
        if export.measured
        else figures.UNKNOWN.format(missing="it was not asked for"),
        "faults": operation.fault_codes(code.general),
        "silence": operation.silence(export.record, firmware),
        "wear": operation.wear(export, served),
        "stage": _stage(export),
        "services": _services(export, code),
        "tested": _tested(export) + (secoc_session.FILES if bus.secured else ""),
        "traced": traceability.NOTE,
    }
    for name, value in values.items():
        page = page.replace(f"{{{name}}}", value)
    return page


def _stage(export: Export) -> str:
    if export.stage is None:
        return ""
    module = "ecu" if export.specialised else "stage"
    return (
        f"\n\nAn own stage is part of the loop, `stage/{export.stage.file}`, translated to "
        f"`src/canroll_{module}.c`. It is compiled in, so every calibration runs with it."
    )


def _services(export: Export, code: Code) -> str:
    kinds = (SERVICES[name] for name in export.services)
    notes = [resolve_name(kind.note)(export, code) for kind in kinds if kind.note]
    if code.loop.bus.secured:
        notes.append(secoc_session.NOTE)
    return "".join(notes)


def _tested(export: Export) -> str:
    return "".join(SERVICES[name].tested for name in export.services)


def _frames(bus: BusMap) -> Iterator[str]:
    yield "| | number | identifier | bytes | protection | frame |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for word, boxes in (("receive", bus.received), ("send", bus.transmitted)):
        for number, box in enumerate(boxes):
            if box.name:
                wide = " (29 bits)" if box.ident & EXTENDED else ""
                ident = f"0x{box.ident & (EXTENDED - 1):X}{wide}"
                kind = described(box.protection)
                name = f"{box.name}: {box.comment}" if box.comment else box.name
                if box.pages:
                    name += f" (page {', '.join(str(page) for page in box.pages)})"
                size = str(box.length)
                if box.fd:
                    size = f"{box.sent_length}, CAN FD{' with BRS' if box.bit_rate_switch else ''}"
                yield f"| {word} | {number} | {ident} | {size} | {kind} | {name} |"


def described(protection: Protection | None) -> str:
    """A short description of a frame's protection: kind, position, bytes covered."""
    if protection is None:
        return "none"
    parts = ["own" if protection.profile == "own" else f"E2E profile {protection.profile}"]
    if protection.checksum is not None:
        parts.append(
            f"checksum in {_where(protection.checksum.place)} over {protection.length} bytes"
        )
    if protection.counter is not None:
        low = protection.counter.place.bits[0]
        parts.append(f"counter 0 to {protection.counter.values - 1} at bit {low}")
    return ", ".join(parts)


def _where(place: Place) -> str:
    """Its byte, or its bytes or bits where it is none."""
    pieces = place.pieces
    if any(piece.width < 8 for piece in pieces):
        return f"{place.width} bits from bit {place.bits[0]} on"
    numbers = [piece.byte for piece in pieces]
    return f"byte {numbers[0]}" if len(numbers) == 1 else f"bytes {min(numbers)} to {max(numbers)}"
