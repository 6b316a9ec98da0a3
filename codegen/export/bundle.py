"""The exported bundle: self-contained sources for a firmware project.

Sources and headers, the calibration as a header, test vectors with a runner, Makefile and
CMakeLists.txt, start-up and example for a bare Cortex-M, A2L, the cantools codec and a README.
"""

import shutil
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from math import gcd
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from codegen.c99.text import filled
from codegen.export import (
    a2l,
    cantools_codec,
    codec_comparison,
    coverage_cases,
    figures,
    interrupts,
    layout,
    misra,
    traceability,
)
from codegen.export.sessions import nvm_session, secoc_session, uds_session, xcp_session
from codegen.frame.frame_protection import Protection
from codegen.frame.place import Place
from codegen.generated.bus_map import BusMap
from codegen.generated.mailbox import EXTENDED
from codegen.generated.own_stage import OwnStage
from codegen.run import memory_image, native, uds_server, xcp_slave
from codegen.run.bus_firmware import BusFirmware, of_bus, with_services, with_stage
from codegen.run.cortex import OPTIMISATION
from codegen.run.ecu_traffic import Traffic
from codegen.run.xcp_slave import PAGE_ADDRESS, STATE_ADDRESS
from codegen.specialise.firmware import specialised
from dbc.reader import Files, each, network_file
from firmware.calibration import Calibration

TEMPLATES = Path(__file__).with_name("templates")
BOARD = Path(__file__).parents[1] / "board"
PLACES = {
    "test_main.c": "test/test_main.c",
    "test_cases.c": "test/test_cases.c",
    "test_codec.py.in": "test/test_codec.py",
    "node.h": "board/node.h",
    "node.c": "board/node.c",
    "example.c": "board/example.c",
    "freertos.c": "freertos/main.c",
    "FreeRTOSConfig.h": "freertos/FreeRTOSConfig.h",
    "zephyr/module.yml": "zephyr/module.yml",
    "zephyr/Kconfig": "zephyr/Kconfig",
    "zephyr/CMakeLists.txt": "zephyr/CMakeLists.txt",
    "zephyr/sample/CMakeLists.txt": "zephyr/sample/CMakeLists.txt",
    "zephyr/sample/prj.conf": "zephyr/sample/prj.conf",
    "zephyr/sample/sample.yaml": "zephyr/sample/sample.yaml",
    "zephyr/sample/src/main.c": "zephyr/sample/src/main.c",
    "library.json": "library.json",
    "Makefile": "Makefile",
    "CMakeLists.txt": "CMakeLists.txt",
    "arm-none-eabi.cmake": "cmake/arm-none-eabi.cmake",
}
"""Where each template goes in the bundle."""
ADDRESSES = {"calibration": PAGE_ADDRESS, "ecu": STATE_ADDRESS}
FNV_OFFSET, FNV_PRIME = 2166136261, 16777619
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
SPECIALISED_FILES = "the loop, in `canroll_ecu.c`; each function names the one it is a copy of"
GENERAL_CASES = """\
The cases in `test/cases.c` run other calibrations than yours, all laws, observers and refusals
among them, on hostile frames. They reach every statement and branch of the loop (`make coverage`
shows it with gcov) but these, which are of the frames of canroll's own bus:

{unreached}"""
SPECIALISED_CASES = """\
The cases in `test/cases.c` run the calibration on hostile frames, and give `canroll_init` records
that it refuses. `make coverage` counts with gcov what they reach."""
FLASHING_NOTE = """ With
`--calibration FILE` it also writes that calibration for the address of the one in your image, as
`calibration.hex` (Intel HEX) and `calibration.s19` (S-record); `--address` does where there is no
image."""
TIE = "canroll_specialised"
TIE_HEADER = """\
/* The CRC of the one calibration that the code was specialised for, as canroll_gains.h has it. */
#ifndef CANROLL_SPECIALISED_H
#define CANROLL_SPECIALISED_H

#include <stdint.h>

#define CANROLL_SPECIALISED_CRC {crc}u

#ifdef __cplusplus
extern "C" {{
#endif

extern const uint32_t canroll_specialised_crc;

#ifdef __cplusplus
}}
#endif

#endif
"""
TIE_SOURCE = """\
/* Refuses to compile with another calibration; canroll_init refuses to run with one. */
#include "canroll_specialised.h"
#include "canroll.h"
#include "canroll_gains.h"

#if CANROLL_CALIBRATION_CRC != CANROLL_SPECIALISED_CRC
#error "canroll_gains.h is not the calibration that the code was specialised for: export it again"
#endif

const uint32_t canroll_specialised_crc = CANROLL_SPECIALISED_CRC;
"""


EPK_HEADER = """\
/* What names this software: canroll.a2l has it too, and the image keeps it. */
#ifndef CANROLL_EPK_H
#define CANROLL_EPK_H

#define CANROLL_VERSION "{version}"
#define CANROLL_EPK "{epk}"

#ifdef __cplusplus
extern "C" {{
#endif

extern const char canroll_epk[sizeof(CANROLL_EPK)];

#ifdef __cplusplus
}}
#endif

#endif
"""
EPK_SOURCE = """\
/* A linker that drops unused data must be told to keep it: -u canroll_epk, or KEEP. */
#include "canroll_epk.h"

const char canroll_epk[sizeof(CANROLL_EPK)] = CANROLL_EPK;
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """Contents of a bundle.

    Attributes:
        record: the calibration.
        gains: text of canroll_gains.h.
        title: description of the design in a line or two, for the README.
        dbc: the network description, in one file or several.
        map_file: mapping of signals to fields.
        traffic: frames that the test vectors replay.
        origin: source of the vectors, a sentence for the README.
        stage: the engineer's own stage in the loop, or None.
        specialised: whether the code is for this calibration alone.
        services: modules beside the loop that are part of it.
        byte_order: that of the target's memory, for the A2L: "little" or "big".
        measured: whether the README has figures, for which the code is compiled and analysed.
    """

    record: Calibration
    gains: str
    title: str
    dbc: Files
    map_file: Path
    traffic: Traffic
    origin: str
    stage: OwnStage | None = None
    specialised: bool = False
    services: tuple[str, ...] = ()
    byte_order: str = "little"
    measured: bool = False


def sources(files: Files, map_file: Path) -> dict[str, str]:
    """The firmware in C for the signals of the description in ``files``, by file name."""
    return of_bus(files, map_file).files


def write(folder: Path, export: Export) -> list[Path]:
    """Write the bundle to ``folder``, created if missing; return the files written."""
    refuse_namesakes(export.dbc)
    firmware = with_stage(of_bus(export.dbc, export.map_file), export.stage)
    loop = specialised(firmware, export.record) if export.specialised else firmware
    served = with_services(loop, export.services)
    files, bus = served.files, firmware.bus
    texts = {
        f"{'src' if name.endswith('.c') else 'include'}/{name}": text
        for name, text in files.items()
    }
    texts["include/canroll_gains.h"] = export.gains
    texts["test/vectors.h"], texts["test/vectors.c"] = _vectors(firmware, export)
    found = coverage_cases.cases(bus)
    if export.specialised:
        found = coverage_cases.cases_of(export.record, bus)
    texts["test/cases.h"], texts["test/cases.c"] = coverage_cases.sources(
        native.library_of(firmware), list(found)
    )
    texts[layout.NAME] = layout.header(firmware.record)
    for name in ("startup.c", "link.ld"):
        texts[f"board/{name}"] = (BOARD / name).read_text(encoding="utf-8")
    fd = any(box.fd for box in bus.transmitted)
    for name, place in PLACES.items():
        text = (TEMPLATES / name).read_text(encoding="utf-8")
        text = text.replace("{version}", version("canroll"))
        text = text.replace("{bytes}", str(export.traffic.frames.dtype["payload"].shape[0]))
        text = secoc_session.example(text, firmware, export.record)
        text = text.replace("{tick_us}", str(export.record.tick_us))
        text = text.replace("{rate}", str(_ticks_a_second(export.record.tick_us)))
        text = text.replace("{fd}", "canroll_signals_tx_fd[slot]" if fd else "0")
        text = text.replace("{fd_conf}", f"CONFIG_CAN_FD_MODE={'y' if fd else 'n'}")
        text = text.replace("{fd_mode}", "CAN_MODE_FD" if fd else "CAN_MODE_NORMAL")
        texts[place] = text.replace("{optimisation}", " ".join(OPTIMISATION))
    epk = f"canroll {version('canroll')} {_named(files)}"
    texts["include/canroll_epk.h"] = EPK_HEADER.format(version=version("canroll"), epk=epk)
    texts["src/canroll_epk.c"] = EPK_SOURCE
    software = a2l.Software(
        epk,
        export.record,
        bus.xcp,
        firmware.record,
        firmware.program(),
        calibrated=not export.specialised,
        slave="xcp" in export.services,
    )
    texts["canroll.a2l"] = a2l.a2l(
        software, ADDRESSES if software.slave else None, export.byte_order
    )
    if software.slave:
        texts.update(xcp_session.sources(served, export.record))
    if "uds" in export.services:
        texts.update(uds_session.sources(served, export.record))
    if "nvm" in export.services:
        texts.update(nvm_session.sources(served, export.record, export.traffic))
    if bus.secured:
        texts.update(secoc_session.sources(firmware))
    if export.specialised:
        crc = export.record.crc & 0xFFFFFFFF
        texts[f"include/{TIE}.h"] = TIE_HEADER.format(crc=f"0x{crc:08X}")
        texts[f"src/{TIE}.c"] = TIE_SOURCE
    comparison = codec_comparison.files(export.dbc, export.map_file, bus)
    texts.update({f"test/{name}": text for name, text in comparison.items()})
    texts.update({f"codec/{name}": text for name, text in cantools_codec.files(export.dbc).items()})
    if not export.specialised:
        texts[traceability.PAGE] = traceability.page(served.program(), files)
    texts["README.md"] = _readme(export, loop, served)
    if export.stage is not None:
        texts[f"stage/{export.stage.file}"] = export.stage.source
    _refuse_mixture(folder, texts)
    written = []
    for name, text in sorted(texts.items()):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        written.append(path)
    return [*written, *(_copy(path, folder) for path in each(export.dbc))]


def refuse_namesakes(files: Files) -> None:
    """Raise CanrollError where files of different folders would be one in the bundle."""
    names = [path.name for path in each(files)]
    for name in names:
        if names.count(name) > 1:
            raise CanrollError(
                f"{name} is the name of several network descriptions, which go into one folder: "
                "rename all but one"
            )


def _copy(path: Path, folder: Path) -> Path:
    """Copy a network description, which may be in any character set; without its defects."""
    copy = folder / path.name
    text = network_file(path).repaired
    if text is None:
        shutil.copyfile(path, copy)
    else:
        copy.write_bytes(text.encode("cp1252", errors="replace"))  # what a DBC is read as
    return copy


def is_specialised(folder: Path) -> bool:
    """Whether the bundle in ``folder`` is for one calibration alone."""
    return (folder / "src" / f"{TIE}.c").is_file()


def _refuse_mixture(folder: Path, texts: Mapping[str, str]) -> None:
    """Raise where sources of another kind of export would be compiled too."""
    for path in sorted(folder.glob("src/canroll*.c")):
        if f"src/{path.name}" not in texts:
            raise CanrollError(
                f"{path}: of an export with other files: remove it or choose another folder"
            )


def _vectors(firmware: BusFirmware, export: Export) -> tuple[str, str]:
    """Header and source of the test vectors, from the compiled reference."""
    library = native.library_of(firmware)
    cals = np.frombuffer(
        memory_image.image(export.record), memory_image.dtype(Calibration), 1
    ).copy()
    replay = library.replay(library.start(cals), cals, [export.traffic], states=True)
    assert replay.states is not None
    frames = export.traffic.frames
    header = [
        "/* Test vectors: what the ECU receives, what it sends, and a digest of each state. */",
        "#ifndef VECTORS_H",
        "#define VECTORS_H",
        "",
        "#include <stdint.h>",
        "",
        f"#define VECTOR_TICKS {export.traffic.ticks}",
        f"#define VECTOR_RECEIVED {len(frames)}",
        f"#define VECTOR_SENT {len(replay.frames)}",
        "",
        "typedef struct {",
        "    int32_t tick, message, length;",
        f"    uint8_t payload[{frames.dtype['payload'].shape[0]}];",
        "} vector_event;",
        "",
        f"extern const int32_t vector_elapsed[{export.traffic.ticks}];",
        f"extern const uint32_t vector_state[{export.traffic.ticks}];",
        f"extern const vector_event vector_received[{max(len(frames), 1)}];",
        f"extern const vector_event vector_sent[{max(len(replay.frames), 1)}];",
        "",
        "#endif",
        "",
    ]
    digests = [f"0x{_digest(state.tobytes()):08X}u" for state in replay.states[0]]
    source = ['#include "vectors.h"', ""]
    source += _array("int32_t vector_elapsed", [str(n) for n in export.traffic.elapsed.tolist()])
    source += _array("uint32_t vector_state", digests)
    source += _array("vector_event vector_received", _events(frames))
    source += _array("vector_event vector_sent", _events(replay.frames))
    return "\n".join(header), "\n".join([*source, ""])


def _events(frames: NDArray[np.void]) -> list[str]:
    rows = []
    for row in frames:
        payload = ", ".join(str(byte) for byte in row["payload"].tolist())
        rows.append(f"{{ {row['tick']}, {row['message']}, {row['length']}, {{ {payload} }} }}")
    return rows or ["{ 0, 0, 0, { 0 } }"]


def _array(head: str, items: list[str]) -> Iterator[str]:
    yield f"const {head}[{len(items)}] = {{"
    yield from filled(f"{item}," for item in items)
    yield "};"
    yield ""


def _ticks_a_second(period_us: int) -> int:
    """A clock of up to 1 kHz, where that will do, by which a period has a whole number of ticks."""
    least = 1_000_000 // gcd(period_us, 1_000_000)
    return least * max(1, 1000 // least)


def _named(files: Mapping[str, str]) -> str:
    """Eight hexadecimal digits that identify the sources."""
    text = "".join(f"{name}\n{text}" for name, text in sorted(files.items()))
    return f"{zlib.crc32(text.encode()):08x}"


def _digest(data: bytes) -> int:
    """FNV-1a, 32 bits."""
    value = FNV_OFFSET
    for byte in data:
        value = ((value ^ byte) * FNV_PRIME) & 0xFFFFFFFF
    return value


def _readme(export: Export, firmware: BusFirmware, served: BusFirmware) -> str:
    bus = firmware.bus
    protection = (
        "Checksums and counters are as the table says."
        if bus.protected and export.record.e2e
        else "The frames carry no end-to-end protection (`calibration.e2e` is 0)."
    )
    text = (TEMPLATES / "README.md").read_text(encoding="utf-8")
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
        "interrupts": interrupts.table(firmware.program()),
        "figures": figures.table(export.record, firmware, served)
        if export.measured
        else figures.UNKNOWN.format(missing="it was not asked for"),
        "stage": _stage(export),
        "services": _services(export, firmware),
        "tested": _tested(export) + (secoc_session.FILES if bus.secured else ""),
        "traced": "" if export.specialised else traceability.NOTE,
    }
    for name, value in values.items():
        text = text.replace(f"{{{name}}}", value)
    return text


def _stage(export: Export) -> str:
    if export.stage is None:
        return ""
    module = "ecu" if export.specialised else "stage"
    return (
        f"\n\nAn own stage is part of the loop, `stage/{export.stage.file}`, translated to "
        f"`src/canroll_{module}.c`. It is compiled in, so every calibration runs with it."
    )


def _services(export: Export, firmware: BusFirmware) -> str:
    notes = []
    if "xcp" in export.services:
        xcp = xcp_slave.idents(firmware)
        notes.append(
            xcp_session.NOTE.format(
                state=f"0x{STATE_ADDRESS:08X}",
                page=f"0x{PAGE_ADDRESS:08X}",
                master=f"0x{xcp.master:X}",
                slave=f"0x{xcp.slave:X}",
            )
        )
    if "uds" in export.services:
        uds = uds_server.idents(firmware)
        notes.append(
            uds_session.NOTE.format(
                request=f"0x{uds.request:X}",
                response=f"0x{uds.response:X}",
                data=uds_session.DATA,
            )
        )
    if "nvm" in export.services:
        notes.append(nvm_session.note(with_services(firmware, export.services)))
    if firmware.bus.secured:
        notes.append(secoc_session.NOTE)
    return "".join(notes)


def _tested(export: Export) -> str:
    files = {"xcp": xcp_session.FILES, "uds": uds_session.FILES, "nvm": nvm_session.FILES}
    return "".join(files.get(name, "") for name in export.services)


def _frames(bus: BusMap) -> Iterator[str]:
    yield "| | number | identifier | bytes | protection | frame |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for word, boxes in (("receive", bus.received), ("send", bus.transmitted)):
        for number, box in enumerate(boxes):
            if box.name:
                wide = " (29 bits)" if box.ident & EXTENDED else ""
                ident = f"0x{box.ident & (EXTENDED - 1):X}{wide}"
                its = described(box.protection)
                name = f"{box.name}: {box.comment}" if box.comment else box.name
                if box.pages:
                    name += f" (page {', '.join(str(page) for page in box.pages)})"
                size = str(box.length)
                if box.fd:
                    size = f"{box.sent_length}, CAN FD{' with BRS' if box.bit_rate_switch else ''}"
                yield f"| {word} | {number} | {ident} | {size} | {its} | {name} |"


def described(its: Protection | None) -> str:
    """A short description of a frame's protection: kind, position, bytes covered."""
    if its is None:
        return "none"
    parts = ["own" if its.profile == "own" else f"E2E profile {its.profile}"]
    if its.checksum is not None:
        parts.append(f"checksum in {_where(its.checksum.place)} over {its.length} bytes")
    if its.counter is not None:
        low = its.counter.place.bits[0]
        parts.append(f"counter 0 to {its.counter.values - 1} at bit {low}")
    return ", ".join(parts)


def _where(place: Place) -> str:
    """Its byte, or its bytes or bits where it is none."""
    pieces = place.pieces
    if any(piece.width < 8 for piece in pieces):
        return f"{place.width} bits from bit {place.bits[0]} on"
    numbers = [piece.byte for piece in pieces]
    return f"byte {numbers[0]}" if len(numbers) == 1 else f"bytes {min(numbers)} to {max(numbers)}"
