"""The commands: their help lines, where their options are, and their handlers.

Nothing heavy is imported here: a command's module is imported after its options are parsed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from canroll.cli.parser import Parser


@dataclass(frozen=True, slots=True)
class Subcommand:
    """A subcommand.

    ``options``: the "module:function" in this package that adds the options to its parser;
    ``handler``: that called with the parsed arguments, by default ``run`` of the module named like
    the command.
    """

    help: str
    options: str
    handler: str = ""


def handler(name: str) -> str:
    """Return "module:function", the handler of a command."""
    return f"canroll.cli.{COMMANDS[name].handler or name.replace('-', '_') + ':run'}"


def parser_of(name: str) -> "Parser":
    """Return the parser of a subcommand."""
    parser: Parser = resolve_name("canroll.cli.parser:Parser")(prog=f"canroll {name}")
    resolve_name(f"canroll.cli.{COMMANDS[name].options}")(parser)
    return parser


COMMANDS = {
    "run": Subcommand(
        "run a manoeuvre in virtual time, with and without control", "run_parsers:run"
    ),
    "compare": Subcommand("compare several runs or laws on one page", "run_parsers:compare"),
    "report": Subcommand(
        "evaluate a saved run again and write its page", "run_parsers:report", handler="run:report"
    ),
    "sweep": Subcommand(
        "run over a range of speeds or over several laws",
        "run_parsers:sweep",
        handler="compare:sweep",
    ),
    "limit": Subcommand(
        "highest speed at which a manoeuvre passes",
        "run_parsers:limit",
        handler="vehicle_tests:limit",
    ),
    "understeer": Subcommand(
        "understeer and roll gradient on a circle (ISO 4138)",
        "run_parsers:understeer",
        handler="vehicle_tests:understeer",
    ),
    "vehicle": Subcommand(
        "a vehicle file from mass and size; a vehicle beside its class; a tyre file from a table",
        "run_parsers:vehicle",
    ),
    "fit": Subcommand("a vehicle's numbers from a measured drive", "run_parsers:fit"),
    "validate": Subcommand("a verdict on a vehicle by measured drives", "run_parsers:validate"),
    "response": Subcommand(
        "yaw and roll frequency response to steering (ISO 7401)",
        "run_parsers:response",
        handler="vehicle_tests:response",
    ),
    "design": Subcommand("design a controller and write its calibration", "design_parsers:design"),
    "margins": Subcommand(
        "verify a calibration independently of its design", "design_parsers:margins"
    ),
    "certify": Subcommand(
        "prove a calibration stable for every sequence of delays", "design_parsers:certify"
    ),
    "bus": Subcommand("bus load, response times and a bus server", "bus_parsers:bus"),
    "hil": Subcommand("run ECU and plant as two processes in real time", "realtime_parsers:hil"),
    "ecu": Subcommand("the ECU alone, on any python-can interface", "realtime_parsers:ecu"),
    "plant": Subcommand("the vehicle alone, on any python-can interface", "realtime_parsers:plant"),
    "watch": Subcommand("watch the roll controller from the bus", "realtime_parsers:watch"),
    "export-c": Subcommand(
        "export the controller as C99 with test vectors", "design_parsers:export_c"
    ),
    "export-fmu": Subcommand(
        "export ECU, plant or bus as an FMU (FMI 3.0)",
        "design_parsers:export_fmu",
        handler="export_fmu:run",
    ),
    "timing": Subcommand(
        "instructions, stack and sizes on the target; budget verdict", "design_parsers:timing"
    ),
    "prove": Subcommand(
        "prove the loop free of overflow for every accepted calibration", "design_parsers:prove"
    ),
    "reproduce": Subcommand("recompute the tables of the four papers", "study_parsers:reproduce"),
    "campaign": Subcommand(
        "Monte Carlo over parameters, noise, delays and faults", "study_parsers:campaign"
    ),
    "faults": Subcommand(
        "drive and judge a catalogue of faults",
        "study_parsers:faults",
        handler="faults:run",
    ),
    "attacks": Subcommand(
        "attackers on the bus, without authentication and with it",
        "study_parsers:attacks",
        handler="faults:attacks",
    ),
    "severe": Subcommand(
        "severe manoeuvres over a population of vehicles",
        "study_parsers:severe",
        "vehicle_tests:severe",
    ),
    "completion": Subcommand(
        "script for the completion of a shell", "listing:completion", handler="listing:complete"
    ),
    "list": Subcommand(
        "laws, vehicles, scenarios and their options, buses and bodies by name",
        "listing:listing",
        handler="listing:run",
    ),
}
"""Every subcommand by its name."""
TASKS: Mapping[str, tuple[str, ...]] = {
    "simulate": ("run", "compare", "sweep", "report"),
    "design": ("design", "margins", "certify", "prove"),
    "assess": ("campaign", "severe", "faults", "attacks", "reproduce"),
    "characterise a vehicle": ("vehicle", "fit", "validate", "limit", "understeer", "response"),
    "network": ("bus",),
    "hardware": ("hil", "ecu", "plant", "watch"),
    "export": ("export-c", "export-fmu", "timing"),
    "names": ("list", "completion"),
}
"""The commands by what they are for."""
