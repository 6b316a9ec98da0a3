"""The commands: help line, options and handler of each.

Nothing heavy is imported here: a command's module is imported after its options are parsed.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from canroll.errors import CanrollError
from codegen.run import BACKENDS
from hil.cli.options import (
    DEFAULT_SCENARIO,
    OF_A_RUN,
    add_answer,
    add_choices,
    add_execution,
    add_json,
    add_numbers,
    add_recording,
    add_scenario,
    add_verbose,
    key_value,
    path_named,
    scenario,
)
from hil.runs.choices import CHOICES, OF_ONE_MANOEUVRE

DEFAULT_SPEEDS = "60:120:20"
DEFAULT_DELAY_MS = 20.0
DEFAULT_DRAWS = 100
EVENT_NAMES = (
    *("fails", "rollover", "rollover_passive", "wheel_lift", "wheel_lift_passive"),
    *("limit_cycle", "harm"),
)
"""Events of a draw, see :mod:`hil.campaign.events`."""
RARE_EVENTS = tuple(name for name in EVENT_NAMES if name not in ("fails", "limit_cycle"))
"""Those that can be approached by levels."""
KINDS = ("laws", "vehicles", "scenarios", "options", "buses", "bodies")
OF_A_DESIGN = (
    *("vehicle", "law", "stage", "actuator", "observer", "tick_ms", "trigger", "heartbeat_ms"),
    *("gains", "matrices", "unverified", "moment_share", "feedforward", "identification"),
    "offset_learning",
    *("response_watch", "bus"),
)
OF_A_DRIVE = ("plant", "speed_kmh", "options")
"""Choices of the runs in which laws are compared."""
LOADS = ("laden", "empty")
PROCESSORS = tuple(name for name in BACKENDS if name.startswith("cortex"))


@dataclass(frozen=True, slots=True)
class Command:
    """A subcommand.

    ``options`` adds options to the command's parser, or is the "module:function" in this package
    that does, if it imports python-can; None: ``add_parser`` of the command's module makes the
    parser. ``handler`` is the "module:function" in this package called with the parsed arguments,
    by default ``run`` of the module named like the command.
    """

    help: str
    options: Callable[[argparse.ArgumentParser], None] | str | None = None
    handler: str = ""


def handler(name: str) -> str:
    """Return "module:function", the handler of a command."""
    return f"hil.cli.{COMMANDS[name].handler or name.replace('-', '_') + ':run'}"


def run(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll run``."""
    parser.description = "Drive a manoeuvre in virtual time, without and with control, and report."
    add_scenario(parser)
    add_choices(parser, CHOICES)
    add_recording(parser)
    parser.add_argument(
        "--no-trace",
        dest="trace",
        action="store_false",
        help="without trace.npz, some 40 MB a minute: the run cannot be read again",
    )
    add_answer(parser, "report, log, header")
    add_verbose(parser, "response times, trigger and phase")


def compare(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll compare``."""
    parser.description = (
        "Drive the same manoeuvre with several controllers and compare them; saved runs are read "
        "from their folders. Options apply to the new runs."
    )
    parser.add_argument(
        "runs",
        nargs="+",
        metavar="RUN",
        help="a law, a calibration file, choices as law=lqr,bus=gateway_20ms,name=slow, or the "
        "folder of a saved run",
    )
    parser.add_argument(
        "--scenario",
        type=scenario,
        default=DEFAULT_SCENARIO,
        help="manoeuvre (default: %(default)s)",
    )
    add_choices(parser, CHOICES)
    add_execution(parser, "run", "resume")
    add_answer(parser, "the page")


def sweep(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll sweep``."""
    parser.description = (
        "Drive a manoeuvre at several speeds with one or several laws, calibrations or settings."
    )
    parser.add_argument(
        "what",
        nargs="*",
        metavar="SCENARIO|RUN",
        help=f"manoeuvre (default: {DEFAULT_SCENARIO}), and what to drive, as of compare: a law, "
        "a calibration file, or choices as law=lqr,bus=gateway_20ms (default: options)",
    )
    parser.add_argument(
        "--speed",
        dest="speeds",
        metavar="FROM:TO:STEP",
        default=DEFAULT_SPEEDS,
        help="default: %(default)s",
    )
    names = [name for name in OF_A_RUN if name != "speed_kmh"]
    add_choices(parser, names, several=("law",))
    add_execution(parser, "run", "resume")
    add_answer(parser, "the page")


def report(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll report``."""
    parser.description = (
        "Read a run from the folder written by 'canroll run' or 'canroll hil', evaluate it again "
        "and write its page. Several runs on one page: 'canroll compare FOLDER FOLDER'."
    )
    parser.add_argument("folder", type=path_named, metavar="FOLDER", help="folder of a saved run")
    parser.add_argument(
        "--out",
        type=path_named,
        metavar="FILE",
        help="the page (default: report.html in the folder)",
    )
    add_json(parser)
    add_verbose(parser, "response times, trigger and phase")


def limit(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll limit``."""
    parser.description = (
        "Bisect the entry speed for the highest at which the manoeuvre's criteria are met, without "
        "and with control: no two wheels of a side two inches off the road, no cone hit, the yaw "
        "rate decayed, as required by its standard."
    )
    add_scenario(parser)
    names = [name for name in OF_A_RUN if name != "speed_kmh"]
    add_choices(parser, names)
    parser.add_argument("--from", dest="low", type=float, default=30.0, metavar="KMH")
    parser.add_argument("--to", dest="high", type=float, metavar="KMH", help="default: fastest")
    parser.add_argument(
        "--tolerance", type=float, default=0.5, metavar="KMH", help="final bracket (default: 0.5)"
    )
    add_json(parser)


def understeer(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll understeer``."""
    parser.description = (
        "Drive a circle at increasing speed; steering, roll and sideslip of each steady turn, and "
        "the gradients of their linear part."
    )
    add_choices(parser, ("vehicle", "plant"))
    parser.add_argument("--radius", type=float, default=100.0, metavar="M", help="default: 100")
    add_json(parser)


def response(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll response``."""
    parser.description = (
        "Steer in sines of rising frequency; yaw rate, lateral acceleration and roll angle per "
        "steering-wheel angle. With --linear: the plant linearised about straight running or a "
        "steady curve, its modes, its responses to moment and steering, and its distance to the "
        "design model."
    )
    add_choices(parser, ("vehicle", "plant"))
    parser.add_argument("--speed", type=float, default=100.0, metavar="KMH", help="default: 100")
    parser.add_argument(
        "--load", choices=LOADS, default=LOADS[0], help="laden or empty (default: %(default)s)"
    )
    parser.add_argument("--linear", action="store_true", help="linearise instead of steering")
    parser.add_argument(
        "--lateral-acceleration",
        type=float,
        metavar="M/S2",
        help="with --linear: that of the steady curve (default: 0, straight ahead)",
    )
    parser.add_argument(
        "--friction", type=float, metavar="MU", help="with --linear: that of the road (default: 1)"
    )
    parser.add_argument(
        "--out", type=path_named, metavar="DIR", help="with --linear: write response.png there"
    )
    add_json(parser)


def design(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll design``."""
    add_choices(parser, (*OF_A_DESIGN, "dbc", "map"), defaults={"bus": None})
    parser.add_argument(
        "--delay",
        type=float,
        metavar="MS",
        help=f"delay from sample to force, instead of --bus (default: {DEFAULT_DELAY_MS:g})",
    )
    parser.add_argument(
        "--delay-min", type=float, metavar="MS", help="smallest delay, if it varies"
    )
    parser.add_argument(
        "--gamma",
        type=float,
        default=0.0,
        metavar="LEVEL",
        help="H-infinity level that the theorem of hinf_delay must certify (default: the smallest)",
    )
    parser.add_argument(
        "--compare", action="store_true", help="design every law for the vehicle, write nothing"
    )
    parser.add_argument(
        "--runs",
        type=int,
        metavar="N",
        help="with --compare: drive all laws at equal effort over the bus, N vehicles of a "
        "population, the same for every law",
    )
    parser.add_argument(
        "--scenario", type=scenario, help=f"with --runs: manoeuvre (default: {DEFAULT_SCENARIO})"
    )
    parser.add_argument(
        "--effort",
        type=float,
        metavar="NM",
        help="with --runs: common RMS moment (default: half of what holds the body upright)",
    )
    add_spread(parser)
    add_choices(parser, OF_A_DRIVE)
    add_json(parser)
    add_verbose(parser, "the numbers without a limit")
    parser.add_argument(
        "--out",
        type=path_named,
        metavar="DIR",
        help="folder for the files (default: out); with --runs for finished laws, until all are",
    )
    add_execution(parser, "law")


def margins(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll margins``."""
    parser.add_argument("calibration", type=path_named, help="calibration.toml of canroll design")
    add_json(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="write margins.png there")


def certify(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll certify``."""
    parser.description = (
        "Prove the loop of a calibration's integers stable for every sequence of delays, bound "
        "what roundings do, and write a certificate that a checker of 200 lines can check alone."
    )
    parser.add_argument("calibration", type=path_named, help="calibration.toml of canroll design")
    add_choices(parser, ("vehicle", "bus"))
    add_json(parser)
    parser.add_argument(
        "--out",
        type=path_named,
        metavar="FILE",
        help="certificate (default: certificate.json beside the calibration)",
    )


def timing(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll timing``."""
    add_choices(parser, [name for name in OF_A_RUN if name != "backend"])
    parser.add_argument(
        "--scenario", type=scenario, default=DEFAULT_SCENARIO, help="manoeuvre to replay"
    )
    parser.add_argument("--duration", type=float, default=5.0, help="duration in s (default: 5)")
    parser.add_argument(
        "--processor", default="cortex-m4", choices=PROCESSORS, help="default: %(default)s"
    )
    parser.add_argument(
        "--counter",
        choices=("qemu", "unicorn"),
        help="instruction counter (default: qemu if installed)",
    )
    parser.add_argument(
        "--specialise",
        action="store_true",
        help="the firmware specialised for the calibration, as export-c --specialise writes it",
    )
    parser.add_argument(
        "--hil", action="store_true", help="run in real time; verdict on tick, latency and misses"
    )
    parser.add_argument(
        "--bound",
        action="store_true",
        help="worst case of a tick in cycles from the machine code, with the maximum seen",
    )
    parser.add_argument(
        "--ticks", type=int, default=4000, help="with --bound: ticks replayed (default: 4000)"
    )
    parser.add_argument(
        "--clock", type=float, metavar="MHZ", help="with --bound: clock, for the share of a tick"
    )
    parser.add_argument(
        "--wait-states", type=int, default=0, metavar="N", help="with --bound: of the flash"
    )
    parser.add_argument(
        "--multiplier",
        type=int,
        default=1,
        metavar="CYCLES",
        help="with --bound: of a multiplication on a Cortex-M0, 1 or 32 (default: 1)",
    )
    parser.add_argument(
        "--division",
        type=int,
        default=12,
        metavar="CYCLES",
        help="with --bound: of a division on M3 and M4 at most (default: 12)",
    )
    add_json(parser)


def prove(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll prove``."""
    parser.add_argument(
        "calibration",
        nargs="?",
        type=path_named,
        help="calibration.toml of a design (default: every calibration the ECU accepts)",
    )
    add_choices(parser, ("stage",))
    add_json(parser)


def reproduce(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll reproduce``."""
    parser.description = (
        "Recompute every table of the papers with the complete tool chain and compare."
    )
    parser.add_argument(
        "papers",
        nargs="*",
        metavar="PAPER",
        help="redondo2021, viadero2022, vu2020, yim2020 (default: all)",
    )
    parser.add_argument(
        "--runs",
        type=int,
        metavar="N",
        help="paired runs of each law for the comparison with ours (default: 20; 0: none)",
    )
    add_execution(parser, "", "only")
    add_answer(parser, "the page")


def completion(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll completion``."""
    parser.description = (
        "Print a script that completes commands, options and names: "
        "source <(canroll completion bash)"
    )
    parser.add_argument("shell", choices=("bash", "zsh", "tcsh"))


def listing(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll list``."""
    parser.description = (
        "List all names of a kind: built in, or from an installed package's entry points. "
        "Laws, scenarios, buses and bodies can also be named as file.py:name or module:name."
    )
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=", ".join(KINDS))
    add_json(parser)


def add_spread(parser: argparse.ArgumentParser) -> None:
    """Add the option for the spread of a vehicle population."""
    parser.add_argument(
        "--spread",
        action="append",
        type=key_value,
        default=[],
        metavar="QUANTITY=SHARE",
        help="half-width of the range of a quantity, e.g. roll_stiffness=0.3; 0: not varied. "
        "Default: 0.2 of roll_inertia, roll_damping, roll_stiffness, sprung_mass, "
        "cg_height_above_roll_axis and estimate_error, 0.1 of cornering_stiffness and friction, "
        "0 of speed; may be repeated",
    )


def campaign(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll campaign``."""
    parser.description = (
        "Drive a manoeuvre with one calibration on many draws of vehicle, noise, bus and fault: "
        "those of a campaign file, or of the options. The controller is designed for the first "
        "bus; one or none of the given faults is drawn; --seed is that of the draws. "
        "'canroll campaign merge FOLDER…' joins the shards of a campaign."
    )
    parser.add_argument(
        "what",
        nargs="*",
        metavar="SCENARIO|FILE.toml|merge FOLDER…",
        help=f"manoeuvre (default: {DEFAULT_SCENARIO}), campaign file, or 'merge' and the --out "
        "folders of all shards",
    )
    parser.add_argument(
        "--runs", type=int, metavar="N", help=f"draws (default: the file's, or {DEFAULT_DRAWS})"
    )
    add_spread(parser)
    parser.add_argument(
        "--worst-by",
        default="reduction",
        metavar="METRIC",
        help="what the hardest draws go by after failures: reduction of the roll angle, or the "
        "largest value with control of a metric such as roll_max_deg (default: %(default)s)",
    )
    parser.add_argument(
        "--until",
        type=float,
        metavar="WIDTH",
        help="stop when the 95 %% interval of the event's probability is as narrow",
    )
    parser.add_argument(
        "--event",
        choices=EVENT_NAMES,
        default=EVENT_NAMES[0],
        help=f"event of --until: {', '.join(EVENT_NAMES)} (default: %(default)s)",
    )
    parser.add_argument(
        "--rare",
        choices=RARE_EVENTS,
        help=f"estimate the probability of a rare event by subset simulation instead: "
        f"{', '.join(RARE_EVENTS)}",
    )
    parser.add_argument(
        "--samples",
        type=int,
        default=1000,
        metavar="N",
        help="with --rare: samples on each level (default: %(default)s)",
    )
    parser.add_argument(
        "--shard",
        type=shard,
        metavar="I/N",
        help="drive the I-th of N parts, to be merged later",
    )
    add_execution(parser, "draw")
    add_choices(parser, OF_A_RUN, several=("bus",))
    add_answer(parser, "page and table")
    parser.set_defaults(verbose=False)


def shard(text: str) -> tuple[int, int]:
    """Return the numbers of "I/N"."""
    first, _, of = text.partition("/")
    if not (first.isdecimal() and of.isdecimal()) or not 1 <= int(first) <= int(of):
        raise CanrollError(f"--shard {text}: must be I/N with I from 1 to N, e.g. 2/8")
    return int(first), int(of)


def faults(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll faults``."""
    parser.description = (
        "Drive a manoeuvre with each fault of a catalogue, single and double, and judge what was "
        "detected, when, and with what harm. Exit code 1 if anything harmful goes undetected."
    )
    add_scenario(parser, DEFAULT_SCENARIO)
    parser.add_argument("--all", action="store_true", help="list every fault, not only the worst")
    parser.add_argument(
        "--catalogue", type=path_named, metavar="FILE", help="TOML file (default: the shipped one)"
    )
    add_choices(parser, [name for name in OF_A_RUN if name not in ("faults", "fault_file")])
    add_execution(parser, "fault")
    add_numbers(parser)


def severe(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll severe``."""
    parser.description = (
        "Drive lane changes, fishhook, J-turn, sine with dwell and one-sided bumps with a "
        "population of vehicles: without control, with the best passive bar, with the plain "
        "feedforward, and with a law."
    )
    names = [name for name in OF_A_RUN if name not in OF_ONE_MANOEUVRE]
    add_choices(parser, names)
    parser.add_argument(
        "--runs", type=int, default=20, metavar="N", help="vehicles (default: %(default)s)"
    )
    add_spread(parser)
    add_execution(parser, "pair of manoeuvre and vehicle")
    add_numbers(parser)


COMMANDS = {
    "run": Command("run a manoeuvre in virtual time, with and without control", run),
    "compare": Command("compare several runs or laws on one page", compare),
    "report": Command(
        "evaluate a saved run again and write its page", report, handler="run:report"
    ),
    "sweep": Command(
        "run over a range of speeds or over several laws", sweep, handler="compare:sweep"
    ),
    "limit": Command(
        "highest speed at which a manoeuvre passes", limit, handler="vehicle_tests:limit"
    ),
    "understeer": Command(
        "understeer and roll gradient on a circle (ISO 4138)",
        understeer,
        handler="vehicle_tests:understeer",
    ),
    "response": Command(
        "yaw and roll frequency response to steering (ISO 7401)",
        response,
        handler="vehicle_tests:response",
    ),
    "design": Command("design a controller and write its calibration", design),
    "margins": Command("verify a calibration independently of its design", margins),
    "certify": Command("prove a calibration stable for every sequence of delays", certify),
    "bus": Command("bus load, response times and a bus server", "bus_parsers:bus"),
    "hil": Command("run ECU and plant as two processes in real time", "bus_parsers:hil"),
    "ecu": Command("the ECU alone, on any python-can interface", "bus_parsers:ecu"),
    "plant": Command("the vehicle alone, on any python-can interface", "bus_parsers:plant"),
    "watch": Command("watch the roll controller from the bus"),
    "export-c": Command("export the controller as C99 with test vectors"),
    "export-fmu": Command(
        "export ECU, plant or bus as an FMU (FMI 3.0)", handler="exchange.export_fmu:run"
    ),
    "timing": Command("instructions, stack and sizes on the target; budget verdict", timing),
    "prove": Command("prove the loop free of overflow for every accepted calibration", prove),
    "reproduce": Command("recompute the tables of the four papers", reproduce),
    "campaign": Command("Monte Carlo over parameters, noise, delays and faults", campaign),
    "faults": Command(
        "drive and judge a catalogue of faults", faults, handler="studies.faults:run"
    ),
    "attacks": Command(
        "attackers on the bus, without authentication and with it",
        "bus_parsers:attacks",
        handler="studies.attacks:run",
    ),
    "severe": Command(
        "severe manoeuvres over a population of vehicles", severe, "vehicle_tests:severe"
    ),
    "completion": Command("script for the completion of a shell", completion),
    "list": Command(
        "laws, vehicles, scenarios and their options, buses and bodies by name",
        listing,
        handler="main:list_names",
    ),
}
"""Every subcommand by its name."""
