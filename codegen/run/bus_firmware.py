"""The ECU loop for the frames of one bus: its C sources, and its modules for CPython.

A DBC and a map make three modules of the firmware, an own stage two, a file of own checksums one;
all others stay as they are.
The state record differs in the room of its mailboxes and in the fields of a stage, so whatever
reads one takes its class from here.
"""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from canroll import dbc
from canroll.codegen.c99 import kept
from canroll.codegen.generated.bus_map import BusMap, load
from canroll.codegen.generated.mailbox import room
from canroll.codegen.generated.own_stage import OwnStage
from canroll.codegen.run.service import SERVICES
from canroll.dbc.reader import Files
from canroll.errors import CanrollError
from canroll.firmware.state import Ecu

if TYPE_CHECKING:
    from canroll.codegen.subset.program import Program

Result = TypeVar("Result")
MAP = dbc.PATH.with_suffix(".toml")
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
        calibration: the only one that its C is for, as in memory; empty: it is for any.
        slots: mailboxes that receive a frame, by its identifier.
        messages: numbers by which ``receive`` takes a frame, by its identifier: its mailboxes, or
            beyond them the slots in which the ECU itself sends it.
        sent: identifier and length on the wire of the frame in each mailbox that sends.
    """

    bus: BusMap
    modules: Mapping[str, str]
    stage: OwnStage | None = None
    services: tuple[str, ...] = ()
    calibration: bytes = b""
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
        if not self.modules and not self.services and not self.calibration:
            return kept.translation("ecu", self._translated)
        return kept.translation(self._parts, self._translated)

    def kept(self, what: str, make: Callable[[], Result]) -> Result:
        """Return what ``make`` makes of the firmware and ``what`` alone, or made before."""
        return kept.translation((what, *self._parts), make)

    @property
    def _parts(self) -> tuple[object, ...]:
        """What makes it beside the firmware as checked in."""
        allowed = [(SERVICES[name].stores, SERVICES[name].records) for name in self._beside]
        own = sorted(self.modules.items()), self.services, allowed, sorted(self._shown.items())
        return (*own, self.calibration) if self.calibration else own

    def _translated(self) -> dict[str, str]:
        files: dict[str, str] = _translation().translated(
            self.program(), self.stage, self.calibration, services=self._beside
        )
        return files

    def program(self) -> "Program":
        """The firmware as data, read anew."""
        program: Program = _translation().program_of(self.modules, self.services, self._shown)
        return program

    @cached_property
    def _shown(self) -> dict[str, Path]:
        """Where messages say that a module is."""
        if not self.modules:
            return {}
        shown: dict[str, Path] = _translation().shown(self.bus, self.modules, self.stage)
        return shown | {Path(name).stem: place for name, (place, _) in self._sources.items()}

    @property
    def _beside(self) -> list[str]:
        """Its services but that of a bus with authenticated frames, which is the firmware's own."""
        return [name for name in self.services if name != AUTHENTICATION]

    @property
    def _sources(self) -> Mapping[str, tuple[Path, str]]:
        """Place and text of the services' modules, by file name."""
        return _sources(self.services)

    @cached_property
    def loop(self) -> ModuleType:
        """The module with ``init``, ``receive`` and ``tick``, for CPython."""
        if not self.modules:
            return importlib.import_module("canroll.firmware.ecu")
        loop: ModuleType = _translation().imported(self.modules, self.services)
        return loop

    @property
    def heard(self) -> frozenset[int]:
        """Identifiers of all frames that it takes, the commands of services among them."""
        heard = (SERVICES[name].hears(self.bus) for name in self._beside)
        return frozenset({*self.messages, *(ident for ident in heard if ident is not None)})

    @property
    def fd(self) -> dict[int, bool]:
        """For each identifier of a CAN FD frame, whether the bit rate is switched."""
        boxes = (*self.bus.received, *self.bus.transmitted)
        return {box.ident: box.bit_rate_switch for box in boxes if box.fd}

    @property
    def room(self) -> int:
        """Bytes of its largest mailbox."""
        return max(room(self.bus.received), room(self.bus.transmitted))

    def module(self, name: str) -> Any:  # noqa: ANN401
        """One of its modules for CPython, with its room's name where it has one."""
        return importlib.import_module(f"{self.loop.__package__}.{name}")

    def function(self, name: str) -> Callable[..., Any]:
        """A function for CPython: ``tick`` of the loop, ``xcp.tick`` of a module beside it."""
        module, _, function = name.rpartition(".")
        if not module:
            return getattr(self.loop, function)  # type: ignore[no-any-return]
        named = _translation().with_room(module)
        return getattr(self.module(named), function)  # type: ignore[no-any-return]

    @property
    def record(self) -> Any:  # noqa: ANN401
        """The class of the state record: that of the firmware's module ``state``."""
        return self.loop.Ecu if self.modules else Ecu


def _translation() -> ModuleType:
    # parser, prover and translator: a third of a command's imports, for what is kept from before
    from canroll.codegen.run import translation  # noqa: PLC0415

    return translation


@cache
def built_in() -> BusFirmware:
    """The firmware for ``dbc/roll_control.dbc``."""
    return BusFirmware(load(dbc.PATH, MAP), {})


def of_bus(files: Files, map_file: Path) -> BusFirmware:
    """Return the firmware for the frames of the description in ``files`` that ``map_file`` maps.

    Raises:
        CanrollError: an inconsistency between DBC and map; the message names file and key.
    """
    if (files, map_file) == (dbc.PATH, MAP):
        return built_in()
    bus = load(files, map_file)
    modules = _translation().modules_of(files, map_file, bus)
    return _of_sources(bus, tuple(sorted(modules.items())))


@cache
def with_stage(firmware: BusFirmware, stage: OwnStage | None) -> BusFirmware:
    """Return ``firmware`` with an engineer's own stage in it, checked and proved.

    Raises:
        CanrollError: file and line of what is outside the subset, no stage, or not proved.
    """
    if stage is None:
        return firmware
    from canroll.codegen.run import stage_modules  # noqa: PLC0415 - the parser, for a stage alone

    modules = {**firmware.modules, **stage_modules.modules(stage)}
    its = replace(firmware, modules=modules, stage=stage)
    # checked and proved as it is translated
    _ = its.files
    return its


@cache
def with_services(firmware: BusFirmware, services: tuple[str, ...]) -> BusFirmware:
    """Return ``firmware`` with services beside the loop."""
    if not services:
        return firmware
    texts = {name: text for name, (_, text) in _sources(services).items()}
    return replace(
        firmware,
        modules={**firmware.modules, **texts},
        services=(*firmware.services, *services),
    )


@cache
def _sources(services: tuple[str, ...]) -> Mapping[str, tuple[Path, str]]:
    """Return place and text of the modules of services, by file name.

    Raises:
        CanrollError: a module that the firmware has, or another service in another package.
    """
    if not services:
        return {}
    from canroll.codegen.subset.program import file_of  # noqa: PLC0415 - the parser, for services alone

    found: dict[str, tuple[Path, str]] = {}
    for name in (name for name in services if name != AUTHENTICATION):
        for file, source in SERVICES[name].sources().items():
            if found.setdefault(file, source) != source or file_of(Path(file).stem).is_file():
                raise CanrollError(f"service {name}: another module is named {file}: rename it")
    return found


@cache
def _of_sources(bus: BusMap, modules: tuple[tuple[str, str], ...]) -> BusFirmware:
    return BusFirmware(bus, dict(modules), services=(AUTHENTICATION,) if bus.secured else ())
