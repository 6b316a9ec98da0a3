"""The exported bundle: self-contained sources for a firmware project.

Sources and headers, the calibration as a header, test vectors with a runner, Makefile and
CMakeLists.txt, start-up and example for a bare Cortex-M, A2L, the cantools codec and a README.
"""

import shutil
import zlib
from collections.abc import Mapping
from importlib.metadata import version
from math import gcd
from pathlib import Path
from pkgutil import resolve_name

from canroll.codegen.export import (
    a2l,
    annotate,
    cantools_codec,
    codec_comparison,
    coverage_cases,
    prefix,
    readme,
    traceability,
)
from canroll.codegen.export.contents import Code, Export
from canroll.codegen.export.sessions import secoc_session
from canroll.codegen.export.sessions.session import Session
from canroll.codegen.run import native
from canroll.codegen.run.bus_firmware import BusFirmware, of_bus, with_services, with_stage
from canroll.codegen.run.cortex import optimisation_of
from canroll.codegen.run.service import SERVICES
from canroll.codegen.run.specialised import specialised
from canroll.dbc.reader import Files, each, network_file
from canroll.errors import CanrollError

__all__ = ["Export", "is_specialised", "refuse_namesakes", "sources", "write"]
TEMPLATES = Path(__file__).with_name("templates")
BOARD = Path(__file__).parents[1] / "board"
PLACES = {
    "session.h": "test/session.h",
    "test_session.c": "test/test_session.c",
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


def sources(files: Files, map_file: Path) -> dict[str, str]:
    """The firmware in C for the signals of the description in ``files``, by file name."""
    return of_bus(files, map_file).files


def write(folder: Path, export: Export) -> list[Path]:
    """Write the bundle to ``folder``, created if missing; return the files written.

    Raises:
        CanrollError: an invalid prefix, or a folder with files of another kind of export.
    """
    prefix.checked(export.prefix)
    refuse_namesakes(export.dbc)
    general = with_stage(of_bus(export.dbc, export.map_file), export.stage)
    loop = specialised(general, export.record) if export.specialised else general
    served = with_services(loop, export.services)
    code = Code(general, loop, served, annotate.files(served))
    texts: dict[str, str] = {}
    for part in PARTS:
        files = part(export, code)
        assert not texts.keys() & files.keys()
        texts |= files
    texts = prefix.renamed(texts, export.prefix)
    _refuse_mixture(folder, texts)
    written = []
    for name, text in sorted(texts.items()):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        written.append(path)
    return [*written, *(_copy(path, folder) for path in each(export.dbc))]


def _loop(export: Export, code: Code) -> dict[str, str]:
    """The firmware, its calibration and the stage that it was made from."""
    texts = {
        f"{'src' if name.endswith('.c') else 'include'}/{name}": text
        for name, text in code.files.items()
    }
    texts["include/canroll_gains.h"] = export.gains
    if export.specialised:
        crc = export.record.crc & 0xFFFFFFFF
        texts[f"include/{TIE}.h"] = TIE_HEADER.format(crc=f"0x{crc:08X}")
        texts[f"src/{TIE}.c"] = TIE_SOURCE
    if export.stage is not None:
        texts[f"stage/{export.stage.file}"] = export.stage.source
    return texts


def _tests(export: Export, code: Code) -> dict[str, str]:
    """The sessions that the bundle tests itself by, and the comparison of its codec."""
    record, bus = export.record, code.general.bus
    if export.specialised:
        cases = coverage_cases.special(code.general, record)
    else:
        cases = coverage_cases.general(code.general)
    texts = {
        "test/session_vectors.c": _vectors(code.general, export),
        "test/session_cases.c": cases,
    }
    for name in export.services:
        if session := SERVICES[name].session:
            texts[f"test/session_{name}.c"] = resolve_name(session)(export, code)
    if bus.secured:
        texts |= secoc_session.sources(code.general)
    comparison = codec_comparison.files(export.dbc, export.map_file, bus)
    return texts | {f"test/{name}": text for name, text in comparison.items()}


def _boards(export: Export, code: Code) -> dict[str, str]:
    """What builds and runs the loop: the templates, and the start of a bare Cortex-M."""
    texts = {
        f"board/{name}": (BOARD / name).read_text(encoding="utf-8")
        for name in ("startup.c", "link.ld")
    }
    fd = any(box.fd for box in code.general.bus.transmitted)
    values = {
        "version": version("canroll"),
        "bytes": str(export.traffic.frames.dtype["payload"].shape[0]),
        "tick_us": str(export.record.tick_us),
        "rate": str(_ticks_a_second(export.record.tick_us)),
        "fd": "canroll_signals_tx_fd[slot]" if fd else "0",
        "fd_conf": f"CONFIG_CAN_FD_MODE={'y' if fd else 'n'}",
        "fd_mode": "CAN_MODE_FD" if fd else "CAN_MODE_NORMAL",
        "optimisation": " ".join(optimisation_of(code.served)),
    }
    for name, place in PLACES.items():
        text = (TEMPLATES / name).read_text(encoding="utf-8")
        text = secoc_session.example(text, code.general, export.record)
        for key, value in values.items():
            text = text.replace(f"{{{key}}}", value)
        texts[place] = text
    return texts


def _described(export: Export, code: Code) -> dict[str, str]:
    """The name of the software, the A2L and the page of traces."""
    files = code.served.files
    described = (SERVICES[name].described for name in export.services)
    slaves = [resolve_name(each)(export.record.tick_us) for each in described if each]
    epk = f"canroll {version('canroll')} {_named(files)}"
    software = a2l.Software(
        epk,
        export.record,
        code.general.bus.xcp,
        code.general.record,
        code.general.program(),
        calibrated=not export.specialised,
        slave=slaves[0] if slaves else None,
    )
    addresses = software.slave.addresses if software.slave else None
    texts = {
        "include/canroll_epk.h": EPK_HEADER.format(version=version("canroll"), epk=epk),
        "src/canroll_epk.c": EPK_SOURCE,
        "canroll.a2l": a2l.a2l(software, addresses, export.byte_order),
    }
    texts[traceability.PAGE] = traceability.page(code.served, code.files)
    return texts


def _codec(export: Export, _: Code) -> dict[str, str]:
    """The frames as a codec by cantools."""
    return {f"codec/{name}": text for name, text in cantools_codec.files(export.dbc).items()}


def _readme(export: Export, code: Code) -> dict[str, str]:
    return {"README.md": readme.text(export, code)}


PARTS = (_loop, _tests, _boards, _described, _codec, _readme)
"""What makes the files of a bundle, by their names in it."""


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
    return any(folder.glob(f"src/*{TIE.removeprefix(prefix.DEFAULT)}.c"))


def description(folder: Path) -> Path:
    """Return the A2L of the bundle in ``folder``, whatever its prefix.

    Raises:
        CanrollError: there is none.
    """
    files = sorted(folder.glob("*.a2l"))
    if not files:
        raise CanrollError(
            f"{folder}: has no .a2l: write the bundle first with canroll export-c {folder}"
        )
    return files[0]


def _refuse_mixture(folder: Path, texts: Mapping[str, str]) -> None:
    """Raise where sources of another kind of export would be compiled too."""
    others = {path.name.removesuffix("_ecu.c") for path in folder.glob("src/*_ecu.c")}
    paths = (path for other in others for path in folder.glob(f"src/{other}*.c"))
    for path in sorted(paths):
        if f"src/{path.name}" not in texts:
            raise CanrollError(
                f"{path}: of an export with other files: remove it or choose another folder"
            )


def _vectors(firmware: BusFirmware, export: Export) -> str:
    """The test vectors, from the compiled reference."""
    session = Session(native.NativeMachine(firmware), firmware)
    session.begin("vectors")
    cal = session.record(export.record)
    ecu = session.record(firmware.record())
    session.call("init", ecu, cal)
    sent = 0
    for elapsed, frames in export.traffic.by_tick():
        sent += session.tick(ecu, cal, elapsed, frames)
    return session.source(
        "The traffic of a run, and the state after every tick.",
        f"{export.traffic.ticks} ticks, {sent} frames sent, all bytes as the reference",
    )


def _ticks_a_second(period_us: int) -> int:
    """A clock of up to 1 kHz, where that will do, by which a period has a whole number of ticks."""
    least = 1_000_000 // gcd(period_us, 1_000_000)
    return least * max(1, 1000 // least)


def _named(files: Mapping[str, str]) -> str:
    """Eight hexadecimal digits that identify the sources."""
    text = "".join(f"{name}\n{text}" for name, text in sorted(files.items()))
    return f"{zlib.crc32(text.encode()):08x}"
