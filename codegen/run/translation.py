"""What makes a bus's firmware: its modules, itself as data and in C, itself for CPython.

Parser, prover, translator and generators are imported here, for what is not kept from before.
"""

import importlib
import importlib.util
import re
import sys
import tempfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from canroll.codegen.c99 import emit
from canroll.codegen.c99.notes import Notes
from canroll.codegen.generated import frames, protection, signals
from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.generated.own_stage import NAME, OwnStage
from canroll.codegen.proof import service_rules, stage_rules
from canroll.codegen.proof.prove import prove
from canroll.codegen.run import memory_image
from canroll.codegen.run.service import SERVICES
from canroll.codegen.subset import grammar, parse, rules
from canroll.codegen.subset.program import FIRMWARE, PACKAGE, Program, copy_sources, file_of
from canroll.dbc.reader import Files
from canroll.firmware.calibration import Calibration

GENERATED = {
    "frames.py": frames.generate,
    "protection.py": protection.generate,
    "signals.py": signals.generate,
}
"""Modules of the firmware that a bus makes."""
PLACE = Path("firmware")
"""Where messages say that generated modules are; their files last no longer than a run."""


def modules_of(files: Files, map_file: Path, bus: BusMap) -> dict[str, str]:
    """Return the sources of the modules that a bus makes, by file name.

    Raises:
        CanrollError: a signal or checksum that cannot be made.
    """
    modules = {name: generate(files, map_file) for name, generate in GENERATED.items()}
    own = protection.own_functions(bus)
    return modules | {f"{name}.py": function.source for name, function in own.items()}


def shown(bus: BusMap, modules: Mapping[str, str], stage: OwnStage | None) -> dict[str, Path]:
    """Return where messages say that each of ``modules`` is."""
    stems = [Path(name).stem for name in modules]
    places = {stem: PLACE / file_of(stem, FIRMWARE).relative_to(FIRMWARE) for stem in stems}
    if stage:
        places[NAME] = stage.path
    return places | {name: own.path for name, own in protection.own_functions(bus).items()}


def translated(
    program: Program,
    stage: OwnStage | None,
    calibration: bytes,
    notes: Notes | None = None,
    services: Sequence[str] = (),
) -> dict[str, str]:
    """Return a firmware in C, by file name; a stage is checked and proved first.

    Of services the rules of the subset and where they store are checked; ``canroll prove`` proves
    them.
    ``calibration`` is the image of the only one that its loop is for; empty: it is for any.

    Raises:
        SubsetError: file and line of what a stage or a service may not do.
    """
    if services:
        rules.check(program)
    for name in services:
        kind = SERVICES[name]
        own = {Path(file).stem for file in kind.sources()}
        records = {
            record: place.rpartition(".")[2]
            for each in (kind, *map(SERVICES.__getitem__, kind.needs))
            for record, place in each.records.items()
        }
        service_rules.check(program, name, own, stores={*kind.stores}, records=records)
    if stage:
        rules.check(program)
        stage_rules.check(program, prove(program, bounded=NAME))
    if not calibration:
        return emit.translated(program, notes)
    record = Calibration()
    memory_image.fill(record, calibration)
    return emit.translated_for(program, memory_image.elements(record), notes)


def program_of(
    modules: Mapping[str, str], services: Sequence[str], places: Mapping[str, Path]
) -> Program:
    """Return the firmware with ``modules`` in place of its own as data, read anew."""
    with folder_of(modules) as folder:
        return parse.load(folder=folder, shown=places, services=services)


def imported(modules: Mapping[str, str], services: Sequence[str]) -> ModuleType:
    """Return the loop of the firmware with ``modules`` in place of its own, for CPython.

    Raises:
        SubsetError: a module is outside the grammar of the subset: none is executed.
    """
    for file, source in modules.items():
        grammar.check(PLACE / file, grammar.parsed(PLACE / file, source))
    text = "".join([*(modules[name] for name in sorted(modules)), *services])
    name = f"canroll_firmware_{zlib.crc32(text.encode()):08x}"
    with folder_of(modules) as folder:
        for path in folder.rglob("*.py"):
            source = path.read_text(encoding="utf-8")
            source = re.sub(
                rf"^from {re.escape(PACKAGE)}\b", f"from {name}", source, flags=re.MULTILINE
            )
            path.write_text(source, encoding="utf-8-sig")  # no other, whatever its first line says
        spec = importlib.util.spec_from_file_location(
            name, folder / "__init__.py", submodule_search_locations=[str(folder)]
        )
        assert spec is not None and spec.loader is not None
        package = importlib.util.module_from_spec(spec)
        sys.modules[name] = package
        spec.loader.exec_module(package)
        # the folder lasts no longer than this: a service is imported now or never
        for service in services:
            place = file_of(service, folder).relative_to(folder).with_suffix("")
            importlib.import_module(".".join((name, *place.parts)))
        return importlib.import_module(f"{name}.ecu")


def with_room(name: str) -> str:
    """Return the dotted name of a module within the firmware."""
    return ".".join(file_of(name).relative_to(FIRMWARE).with_suffix("").parts)


@contextmanager
def folder_of(modules: Mapping[str, str]) -> Iterator[Path]:
    """Yield a folder with all modules of the firmware, ``modules`` in place of its own."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        copy_sources(folder)
        for name, text in modules.items():
            file_of(Path(name).stem, folder).write_text(text, encoding="utf-8")
        yield folder
