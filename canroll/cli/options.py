"""Options shared by several commands: the choices of a run, and its output files."""

import argparse
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from canroll import vehicles
from canroll.cli.parser import FROZEN, RARE, Option, Parser, Relations, flag, opt, repeated
from canroll.codegen.run.service import SERVICES, with_implied
from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.driving import MANEUVERS
from canroll.setup.choice import Choice, one_or_several, several
from canroll.setup.choices import CHOICES, chosen

DEFAULT_OUT = Path("out")
VEHICLE_SET = "--vehicle-set"
DEFAULT_SCENARIO = "double_lane_change"
PACES = ("realtime", "lockstep")
METAVARS = {"km/h": "KMH", "ms": "MS", "s": "S"}
PATTERNS = {"faults": "WHERE=KIND[:VALUE][@START[:END[:RAMP]]]"}
NODES = ("faults", "fault_file", "conditions")
RARE_OF_A_RUN = tuple(name for name in CHOICES if name in RARE)
RARE_OF_A_DESIGN = tuple(name for name in RARE_OF_A_RUN if name in FROZEN)
OF_A_RUN = tuple(name for name in CHOICES if name != "duration")
"""Choices of vehicle, controller and bus."""


def not_empty(text: str) -> str:
    """Return the value of an option; "" is refused."""
    if not text:
        raise argparse.ArgumentTypeError("must not be empty")
    return text


def path_named(text: str) -> Path:
    """Return the path given by an option; "" is refused, as it would mean the current folder."""
    return Path(not_empty(text))


def key_value(text: str) -> tuple[str, str]:
    """Return key and value of "key=value"."""
    if "=" not in text:
        raise CanrollError(f"{text}: expected key=value")
    key, _, value = text.partition("=")
    return key, value


def scenario(text: str) -> str:
    """Return the name of a manoeuvre."""
    if text not in MANEUVERS:
        raise UnknownNameError("scenario", text, MANEUVERS)
    return text


def scenario_named(default: str = "") -> Option:
    """Return the manoeuvre argument; required without a default."""
    names = ", ".join(MANEUVERS)
    if not default:
        return opt("scenario", scenario, None, names)
    return opt("scenario", scenario, None, f"{names} (default: {default})", default, nargs="?")


def choices(
    names: Iterable[str] = OF_A_RUN,
    *,
    several: Collection[str] = (),
    defaults: Mapping[str, Any] | None = None,
    of_file: Sequence[str] = (),
) -> Option:
    """Return the options of choices of a run.

    Args:
        names: names of the choices.
        several: choices that accept several names separated by commas.
        defaults: defaults of this command that differ from the table's.
        of_file: choices that a project file alone says.
    """
    own = defaults or {}

    def add(parser: Parser) -> None:
        group = parser.add_argument_group("sensors and actuators")
        for name in names:
            choice = CHOICES[name]
            if name in own:
                choice = replace(choice, default=own[name])
            _add(group if name in NODES else parser, choice, listed=name in several)
            parser.relate(Relations(excludes=choice.excludes), name)
            parser.set_defaults(**{name: own.get(name)})
            if name == "vehicle":
                VEHICLE_NUMBER(parser)
        parser.of_file += tuple(of_file)
        for action in (action for action in parser._actions if action.dest in of_file):
            action.help = argparse.SUPPRESS

    return add


VEHICLE_NUMBER = repeated(
    VEHICLE_SET, key_value, "KEY=VALUE",
    "another number of the vehicle, such as plant.sprung_mass=2500",
)  # fmt: skip


def _add(parser: "Parser | argparse._ArgumentGroup", choice: Choice, *, listed: bool) -> None:
    add = partial(parser.add_argument, choice.option, dest=choice.name)
    if choice.kind is bool:
        add(action="store_false" if choice.default else "store_true", help=choice.help)
    elif choice.kind in (Mapping, Sequence):
        metavar = PATTERNS.get(choice.name, "KEY=VALUE")
        kind = key_value if choice.kind is Mapping else not_empty
        add(action="append", type=kind, metavar=metavar, help=choice.help)
    elif choice.kind in (float, int):
        metavar = METAVARS.get(choice.unit, choice.word.upper())
        add(type=choice.kind, metavar=metavar, help=_help(choice))
    else:
        metavar = "FILE" if choice.kind is Path else choice.word.upper()
        if listed:
            metavar += ",…"
        add(
            type=partial(_read, choice, listed=listed),
            action=_Again if choice.repeated else "store",
            metavar=metavar,
            help=_help(choice),
        )


class _Again(argparse.Action):
    """Keep one value as it is, several as a tuple."""

    def __call__(self, _parser: object, args: argparse.Namespace, value: Any, _: object) -> None:  # type: ignore[override]  # noqa: ANN401
        before = getattr(args, self.dest)
        given = (value,) if before is None else (*several(before), value)
        setattr(args, self.dest, one_or_several(given))


def _read(choice: Choice, text: str, *, listed: bool) -> Any:  # noqa: ANN401
    return [choice.read(part) for part in text.split(",")] if listed else choice.read(text)


def _help(choice: Choice) -> str:
    names = ", ".join(choice.values())
    text = f"{choice.help}: {names}" if names else choice.help
    return text if choice.default is None else f"{text} (default: {_shown(choice.default)})"


def _shown(default: Any) -> str:  # noqa: ANN401
    return f"{default:g}" if isinstance(default, float) else str(default)


def services(*, exported: bool = False) -> list[str]:
    """Return the services that can run beside the ECU; those that a bundle can have too."""
    named = [name for name in SERVICES if not SERVICES[name].needs]
    return [name for name in named if exported or SERVICES[name].start]


def service_flags(names: Iterable[str]) -> list[Option]:
    """Return an option for each of the services."""
    texts = {name: SERVICES.description(name).removesuffix(".") for name in names}
    return [flag(f"--{name}", text[:1].lower() + text[1:]) for name, text in texts.items()]


def chosen_services(args: argparse.Namespace) -> tuple[str, ...]:
    """Return the chosen services, and those that are there because of them."""
    names = services(exported=True)
    return with_implied(
        tuple(name for name in names if getattr(args, name.replace("-", "_"), False))
    )


def by_key(option: str, pairs: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Return the pairs of an option as a dictionary.

    Raises:
        CanrollError: a key is given twice.
    """
    values: dict[str, str] = {}
    for key, value in pairs:
        if key in values:
            raise CanrollError(f"{option} {key}: given twice: keep {values[key]} or {value}")
        values[key] = value
    return values


def choices_of(args: argparse.Namespace, names: Iterable[str] = CHOICES) -> dict[str, Any]:
    """Return the given values of the choices ``names``, by keyword.

    Raises:
        CanrollError: an invalid number.
    """
    given = {name: getattr(args, name, None) for name in names}
    for name in (name for name in given if CHOICES[name].kind is Mapping):
        given[name] = by_key(CHOICES[name].option, given[name] or ()) or None
    choices = {name: value for name, value in given.items() if value is not None}
    if "vehicle" in given and getattr(args, "vehicle_set", None):
        choices["vehicle"] = _changed(choices, args.vehicle_set)
    for name, value in choices.items():
        if CHOICES[name].kind in (float, int) and not isinstance(value, list):
            CHOICES[name].check(value)
    return choices


def _changed(choices: Mapping[str, Any], changes: Sequence[tuple[str, str]]) -> vehicles.Vehicle:
    """Return the chosen vehicle with the numbers of ``--vehicle-set``.

    Raises:
        CanrollError: no such key, a key given twice, no number, or a calibration is chosen.
    """
    if choices.get("calibration") is not None:
        raise CanrollError(
            f"--calibration fixes the vehicle: omit {VEHICLE_SET}, or drive another one with "
            "--plant-vehicle"
        )
    numbers: dict[str, float] = {}
    for key, text in changes:
        if key in numbers:
            raise CanrollError(f"{VEHICLE_SET} {key} is given twice: give it once")
        try:
            numbers[key] = float(text)
        except ValueError as error:
            raise CanrollError(f"{VEHICLE_SET} {key}={text}: {text!r} is not a number") from error
    return vehicles.load(chosen(choices, "vehicle")).replace(numbers)


EXECUTION = ("jobs", "scheduler", "resume", "only")
"""Options of :func:`execution`."""
ONE_CASE = "--only drives one case"


def execution(case: str, *without: str) -> Option:
    """Return how cases of a study are driven, of which ``case`` N is one, except ``without``."""
    one = {} if "only" in without else {"only": ONE_CASE}
    options = {
        "jobs": opt("--jobs", _processes, "N", "processes (default: all cores)"),
        "scheduler": opt("--scheduler", _scheduler, "ADDRESS", "local processes, or a Dask "
            "scheduler, tcp://HOST:PORT (default: %(default)s)", excludes=one),
        "resume": flag("--resume", "continue from what the output folder has", excludes=one),
        "only": opt("--only", int, "N", f"drive {case} N alone, counted from 0"),
    }  # fmt: skip

    def add(parser: Parser) -> None:
        for name in (name for name in EXECUTION if name not in without):
            options[name](parser)
        parser.set_defaults(jobs=os.cpu_count() or 1, scheduler="local", resume=False, only=None)

    return add


SPREAD = repeated(
    "--spread", key_value, "QUANTITY=SHARE", "half-width of the range of a quantity, e.g. "
    "roll_stiffness=0.3; 0: not varied. Default: 0.2 of roll_inertia, roll_damping, "
    "roll_stiffness, sprung_mass, cg_height_above_roll_axis and estimate_error, 0.1 of "
    "cornering_stiffness and friction, 0 of speed", default=[],
)  # fmt: skip


def _processes(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise CanrollError(f"--jobs must be at least 1, got {text}")
    return int(text)


def _scheduler(text: str) -> str:
    if text != "local" and "://" not in text:
        raise CanrollError(f"--scheduler {text}: must be local or an address, e.g. tcp://host:8786")
    return text


RECORDING = (
    opt("--log", path_named, "FILE", "bus log: .asc .blf .log .mf4 .pcap .pcapng"),
    opt("--signals", path_named, "FILE", "signals: .csv .mf4 .parquet .mcap"),
)
JSON = flag("--json", "print one JSON object")
NUMBERS = (
    opt("--out", path_named, "DIR", "folder for the numbers as JSON, and for finished cases until "
        "then"),
    JSON,
)  # fmt: skip
SECTION = opt(
    "--section", int, "N", "section of a log whose times step, by a clock that was set or a pause "
    "of more than a minute (default: that with most frames)",
)  # fmt: skip


def verbose(more: str) -> Option:
    """Return --verbose, which prints ``more``."""
    everything = {"json": "--json has everything"}
    return flag("--verbose", f"print {more} too", excludes=everything)


def answer(files: str) -> tuple[Option, Option]:
    """Return --out for the result ``files``, and --json."""
    return (
        opt("--out", path_named, "DIR", f"folder for {files} (default: out)"),
        flag("--json", "print one JSON object; files only with --out"),
    )


def folder_of(args: argparse.Namespace) -> Path | None:
    """Return the output folder; None if no files are written."""
    out: Path | None = args.out
    return out or (None if args.json else DEFAULT_OUT)
