"""The ECU loop for the frames of one bus: its C sources, and its modules for CPython.

A DBC and a map make three modules of the firmware, an own stage two, a file of own checksums one;
all others stay as they are.
The state record differs in the room of its mailboxes and in the fields of a stage, so whatever
reads one takes its class from here.
"""

import importlib
import importlib.util
import re
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import firmware.ecu
from codegen.c99 import emit, kept
from codegen.generated import frames, own_stage, protection, signals
from codegen.generated.bus_map import BusMap, frame_ident, load
from codegen.generated.own_stage import OwnStage
from codegen.proof import stage_rules
from codegen.proof.prove import prove
from codegen.subset import parse, rules
from codegen.subset.program import FIRMWARE, Program, copy_sources, file_of
from dbc.reader import Files

Result = TypeVar("Result")
GENERATED = {
    "frames.py": frames.generate,
    "protection.py": protection.generate,
    "signals.py": signals.generate,
}
"""Modules of the firmware that a bus makes."""
PLACE = Path("firmware")
"""Where messages say that generated modules are; their files last no longer than a run."""
AUTHENTICATION = "secoc"
"""The service of a bus with authenticated frames."""


@dataclass(frozen=True, eq=False)
class BusFirmware:
    """The firmware for one bus.

    Attributes:
        bus: the mailboxes and the frames in them.
        modules: sources of the modules that differ from those checked in, by file name.
        stage: the engineer's own stage in it, or None.
        services: modules beside the loop that are part of it.
        slots: mailboxes that receive a frame, by its identifier.
        messages: numbers by which ``receive`` takes a frame, by its identifier: its mailboxes, or
            beyond them the slots in which the ECU itself sends it.
        sent: identifier and length on the wire of the frame in each mailbox that sends.
    """

    bus: BusMap
    modules: Mapping[str, str]
    stage: OwnStage | None = None
    services: tuple[str, ...] = ()
    slots: Mapping[int, tuple[int, ...]] = field(init=False)
    messages: Mapping[int, tuple[int, ...]] = field(init=False)
    sent: tuple[tuple[int, int], ...] = field(init=False)

    def __post_init__(self) -> None:
        slots: dict[int, tuple[int, ...]] = {}
        for slot, box in enumerate(self.bus.received):
            if box.name:
                slots[box.ident] = (*slots.get(box.ident, ()), slot)
        sent = tuple((box.ident, box.sent_length) for box in self.bus.transmitted)
        messages = dict(slots)
        for slot, (ident, length) in enumerate(sent):
            if length:
                messages[ident] = (*messages.get(ident, ()), len(self.bus.received) + slot)
        object.__setattr__(self, "slots", slots)
        object.__setattr__(self, "messages", messages)
        object.__setattr__(self, "sent", sent)

    @cached_property
    def files(self) -> dict[str, str]:
        """The firmware in C, by file name."""
        if not self.modules and not self.services:
            return emit.firmware()
        return kept.translation(self._parts, self._translated)

    def kept(self, what: str, make: Callable[[], Result]) -> Result:
        """Return what ``make`` makes of the firmware and ``what`` alone, or made before."""
        return kept.translation((what, *self._parts), make)

    @property
    def _parts(self) -> tuple[object, ...]:
        """What makes it beside the firmware as checked in."""
        return sorted(self.modules.items()), self.services, sorted(self._shown.items())

    def _translated(self) -> dict[str, str]:
        program = self.program()
        if self.stage:
            rules.check(program)
            stage_rules.check(program, prove(program, bounded=own_stage.NAME))
        return emit.Emitter(program).files()

    def program(self) -> Program:
        """The firmware as data, read anew."""
        with self._folder() as folder:
            return parse.load(folder=folder, shown=self._shown, services=self.services)

    @cached_property
    def _shown(self) -> dict[str, Path]:
        """Where messages say that a module is."""
        stems = [Path(name).stem for name in self.modules]
        shown = {stem: PLACE / file_of(stem, FIRMWARE).relative_to(FIRMWARE) for stem in stems}
        if self.stage:
            shown[own_stage.NAME] = self.stage.path
        return shown | {name: own.path for name, own in protection.own_functions(self.bus).items()}

    @cached_property
    def loop(self) -> ModuleType:
        """The module with ``init``, ``receive`` and ``tick``, for CPython."""
        if not self.modules:
            return firmware.ecu
        parts = [*(self.modules[name] for name in sorted(self.modules)), *self.services]
        text = "".join(parts)
        name = f"canroll_firmware_{zlib.crc32(text.encode()):08x}"
        with self._folder() as folder:
            for path in folder.rglob("*.py"):
                source = path.read_text(encoding="utf-8")
                source = re.sub(r"^from firmware\b", f"from {name}", source, flags=re.MULTILINE)
                path.write_text(source, encoding="utf-8")
            spec = importlib.util.spec_from_file_location(
                name, folder / "__init__.py", submodule_search_locations=[str(folder)]
            )
            assert spec is not None and spec.loader is not None
            package = importlib.util.module_from_spec(spec)
            sys.modules[name] = package
            spec.loader.exec_module(package)
            # the folder lasts no longer than this: a service is imported now or never
            for service in self.services:
                place = file_of(service, folder).relative_to(folder).with_suffix("")
                importlib.import_module(".".join((name, *place.parts)))
            return importlib.import_module(f"{name}.ecu")

    @property
    def heard(self) -> frozenset[int]:
        """Identifiers of all frames that it takes, the commands of services among them."""
        found = set(self.messages)
        if "xcp" in self.services and self.bus.xcp is not None:
            found.add(frame_ident(self.bus.xcp.master))
        if "uds" in self.services and self.bus.uds is not None:
            found.add(frame_ident(self.bus.uds.request))
        return frozenset(found)

    @property
    def fd(self) -> dict[int, bool]:
        """For each identifier of a CAN FD frame, whether the bit rate is switched."""
        boxes = (*self.bus.received, *self.bus.transmitted)
        return {box.ident: box.bit_rate_switch for box in boxes if box.fd}

    @property
    def room(self) -> int:
        """Bytes of its largest mailbox."""
        return max(signals.room(self.bus.received), signals.room(self.bus.transmitted))

    def module(self, name: str) -> Any:  # noqa: ANN401
        """One of its modules for CPython, with its room's name where it has one."""
        return importlib.import_module(f"{self.loop.__package__}.{name}")

    def function(self, name: str) -> Callable[..., Any]:
        """A function for CPython: ``tick`` of the loop, ``xcp.tick`` of a module beside it."""
        module, _, function = name.rpartition(".")
        if not module:
            return getattr(self.loop, function)  # type: ignore[no-any-return]
        place = file_of(module).relative_to(FIRMWARE).with_suffix("")
        return getattr(self.module(".".join(place.parts)), function)  # type: ignore[no-any-return]

    @property
    def record(self) -> Any:  # noqa: ANN401
        """The class of the state record: that of the firmware's module ``state``."""
        return self.loop.Ecu

    @contextmanager
    def _folder(self) -> Iterator[Path]:
        """A folder with all modules of the firmware."""
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            copy_sources(folder)
            for name, text in self.modules.items():
                file_of(Path(name).stem, folder).write_text(text, encoding="utf-8")
            yield folder


@cache
def built_in() -> BusFirmware:
    """The firmware for ``dbc/roll_control.dbc``."""
    return BusFirmware(load(signals.DBC, signals.MAP), {})


def of_bus(files: Files, map_file: Path) -> BusFirmware:
    """Return the firmware for the frames of the description in ``files`` that ``map_file`` maps.

    Raises:
        CanrollError: an inconsistency between DBC and map; the message names file and key.
    """
    if (files, map_file) == (signals.DBC, signals.MAP):
        return built_in()
    modules = {name: generate(files, map_file) for name, generate in GENERATED.items()}
    bus = load(files, map_file)
    own = protection.own_functions(bus)
    modules |= {f"{name}.py": function.source for name, function in own.items()}
    return _of_sources(bus, tuple(sorted(modules.items())))


@cache
def with_stage(firmware: BusFirmware, stage: OwnStage | None) -> BusFirmware:
    """Return ``firmware`` with an engineer's own stage in it, checked and proved.

    Raises:
        CanrollError: file and line of what is outside the subset, no stage, or not proved.
    """
    if stage is None:
        return firmware
    modules = {**firmware.modules, **own_stage.modules(stage)}
    its = replace(firmware, modules=modules, stage=stage)
    # checked and proved as it is translated
    _ = its.files
    return its


@cache
def with_services(firmware: BusFirmware, services: tuple[str, ...]) -> BusFirmware:
    """Return ``firmware`` with services beside the loop."""
    return replace(firmware, services=(*firmware.services, *services)) if services else firmware


@cache
def _of_sources(bus: BusMap, modules: tuple[tuple[str, str], ...]) -> BusFirmware:
    return BusFirmware(bus, dict(modules), services=(AUTHENTICATION,) if bus.secured else ())
