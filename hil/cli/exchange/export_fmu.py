"""``canroll export-fmu ecu|plant|bus OUT.fmu``: parts of a run as FMUs (FMI 3.0, Co-Simulation)."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from canroll.errors import CanrollError, VerdictError
from codegen.fmu import ecu
from hil.cli.options import add_choices, choices_of, path_named
from hil.cli.parsers import DEFAULT_SCENARIO, OF_A_DESIGN
from hil.cli.terminal import show_warnings
from hil.runs.choices import CHOICES
from hil.runs.experiment import plan, tick_offset_ns
from hil.runs.virtual_time import RUN_TIME_NS

OF_AN_ECU = ("calibration", *OF_A_DESIGN, "dbc", "map", "phase_ms", "seed")


@dataclass(frozen=True, slots=True)
class Kind:
    """What can be exported: its writer, and the options that apply to it."""

    write: Callable[[argparse.Namespace], str]
    choices: tuple[str, ...]
    others: tuple[str, ...] = ()


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "export-fmu", help="export a part of a run as a Functional Mock-up Unit (FMI 3.0)"
    )
    parser.add_argument("kind", choices=tuple(KINDS), help="part of the run")
    parser.add_argument("out", type=path_named, metavar="OUT.fmu", help="file to write")
    parser.add_argument(
        "--ports",
        choices=ecu.PORTS,
        default=ecu.CAN,
        help="CAN terminals (fmi-ls-bus), or plain signals (default: %(default)s)",
    )
    names = dict.fromkeys(name for kind in KINDS.values() for name in kind.choices)
    add_choices(parser, [name for name in CHOICES if name in names])
    parser.add_argument(
        "--unverified", action="store_true", help="export even if a check of the design fails"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the FMU."""
    kind = KINDS[args.kind]
    for name in choices_of(args):
        if name not in kind.choices:
            raise CanrollError(f"{CHOICES[name].option} does not apply to the {args.kind}: omit it")
    out: Path = args.out
    if out.suffix != ".fmu":
        raise CanrollError(f"{out}: the name of an FMU ends in .fmu")
    described = kind.write(args)
    print(f"{out}: {described}")
    return 0


def write_ecu(args: argparse.Namespace) -> str:
    """Write the ECU with its calibration."""
    settings, controller = plan(DEFAULT_SCENARIO, **choices_of(args, OF_AN_ECU))
    verified = bool(controller.tables["design"]["verified"])
    if not verified and not args.unverified:
        raise VerdictError(
            f"{controller.law} for {controller.vehicle.name} is not verified: see 'canroll "
            "margins', or export it anyway with --unverified"
        )
    show_warnings(controller.warnings)
    title = (
        f"roll-control ECU, {controller.law} for {controller.vehicle.name}, "
        f"{controller.actuator}{'' if verified else ', NOT VERIFIED'}"
    )
    ecu.write(
        args.out,
        settings.firmware,
        controller.record,
        title=title,
        ports=args.ports,
        phase_ns=tick_offset_ns(settings),
        run_time_ns=RUN_TIME_NS,
    )
    return f"{title}; a tick of {1e3 * controller.tick:g} ms, {args.ports}"


KINDS = {"ecu": Kind(write_ecu, OF_AN_ECU)}
