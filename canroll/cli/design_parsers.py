"""The options of the commands that design, verify, time and export a controller."""

from pathlib import Path

from canroll.cli.options import (
    DEFAULT_SCENARIO,
    EXECUTION,
    OF_A_RUN,
    add_choices,
    add_execution,
    add_json,
    add_services,
    add_spread,
    add_verbose,
    key_value,
    path_named,
    scenario,
)
from canroll.cli.parser import Parser, Relations
from codegen.export.prefix import DEFAULT
from codegen.run import BACKENDS, SERVICES

DEFAULT_DELAY_MS = 20.0
OF_A_DESIGN = (
    *("vehicle", "law", "stage", "actuator", "observer", "tick_ms", "trigger", "heartbeat_ms"),
    *("gains", "matrices", "unverified", "moment_share", "feedforward", "identification"),
    *("offset_learning", "response_watch", "uncertainty", "bus"),
)
OF_A_DRIVE = ("plant", "speed_kmh", "options")
"""Choices of the runs in which laws are compared."""
OF_AN_EXPORT = ("calibration", *OF_A_DESIGN)
BYTE_ORDERS = ("little", "big")
PROCESSORS = tuple(name for name in BACKENDS if name.startswith("cortex"))


def design(parser: Parser) -> None:
    """Design a controller and write its calibration."""
    add_choices(parser, (*OF_A_DESIGN, "dbc", "map"), defaults={"bus": None})
    of_a_bus = {name: "the bus has its delay" for name in ("bus", "dbc")}
    parser.add_argument(
        "--delay",
        excludes=of_a_bus,
        type=float,
        metavar="MS",
        help=f"delay from sample to force, instead of --bus (default: {DEFAULT_DELAY_MS:g})",
    )
    parser.add_argument(
        "--delay-min",
        excludes=of_a_bus,
        type=float,
        metavar="MS",
        help="smallest delay, if it varies",
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
        needs=("compare",),
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
    add_verbose(parser, "the numbers without a limit and the least faults that can be found")
    parser.add_argument(
        "--out",
        type=path_named,
        metavar="DIR",
        help="folder for the files (default: out); with --runs for finished laws, until all are",
    )
    add_execution(parser, "law")
    driven = Relations(needs=("runs",), why="--compare --runs")
    parser.relate(driven, "scenario", "effort", "spread", *OF_A_DRIVE, *EXECUTION)
    every = {"compare": "--compare designs every law"}
    parser.relate(Relations(excludes=every), "law")
    plain = {"compare": "--compare designs laws without a stage"}
    parser.relate(Relations(excludes=plain), "stage")
    line = {"compare": "--compare prints one line a law"}
    parser.relate(Relations(excludes=line), "verbose", "uncertainty")


def margins(parser: Parser) -> None:
    """Verify a calibration independently of its design."""
    parser.add_argument("calibration", type=path_named, help="calibration.toml of canroll design")
    add_json(parser)
    add_verbose(parser, "the least faults that can be found")
    parser.add_argument(
        "--uncertainty",
        action="append",
        type=key_value,
        default=[],
        metavar="KEY=WIDTH",
        help="half-width that the table of detectable faults allows for instead of the "
        "calibration's, such as mass=0.05, and print the table; may be repeated",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="write margins.png there")


def timing(parser: Parser) -> None:
    """Instructions, stack and sizes on the target; budget verdict."""
    add_choices(parser, [name for name in OF_A_RUN if name != "backend"])
    parser.add_argument(
        "--scenario", type=scenario, default=DEFAULT_SCENARIO, help="manoeuvre to replay"
    )
    parser.add_argument("--duration", type=float, default=5.0, help="duration in s (default: 5)")
    on_host = {"hil": "--hil runs on this machine, not the target"}
    bound = ("bound",)
    parser.add_argument(
        "--processor",
        excludes=on_host,
        default="cortex-m4",
        choices=PROCESSORS,
        help="default: %(default)s",
    )
    parser.add_argument(
        "--counter",
        excludes={**on_host, "bound": "--bound reads the code, and replays it by qemu"},
        choices=("qemu", "unicorn"),
        help="instruction counter (default: qemu if installed)",
    )
    parser.add_argument(
        "--specialise",
        excludes=on_host,
        action="store_true",
        help="the firmware specialised for the calibration, as export-c --specialise writes it",
    )
    parser.add_argument(
        "--hil", action="store_true", help="run in real time; verdict on tick, latency and misses"
    )
    parser.add_argument(
        "--bound",
        excludes=on_host,
        action="store_true",
        help="worst case of a tick in cycles from the machine code, with the maximum seen",
    )
    parser.add_argument(
        "--ticks",
        needs=bound,
        excludes=on_host,
        type=int,
        default=4000,
        help="with --bound: ticks replayed (default: 4000)",
    )
    parser.add_argument(
        "--clock",
        needs=bound,
        excludes=on_host,
        type=float,
        metavar="MHZ",
        help="with --bound: clock, for the share of a tick",
    )
    parser.add_argument(
        "--wait-states",
        needs=bound,
        excludes=on_host,
        type=int,
        default=0,
        metavar="N",
        help="with --bound: of the flash",
    )
    parser.add_argument(
        "--multiplier",
        needs=bound,
        excludes=on_host,
        type=int,
        default=1,
        metavar="CYCLES",
        help="with --bound: of a multiplication on a Cortex-M0, 1 or 32 (default: 1)",
    )
    parser.add_argument(
        "--division",
        needs=bound,
        excludes=on_host,
        type=int,
        default=12,
        metavar="CYCLES",
        help="with --bound: of a division on M3 and M4 at most (default: 12)",
    )
    add_json(parser)


def prove(parser: Parser) -> None:
    """Prove the loop free of overflow for every accepted calibration."""
    parser.add_argument(
        "calibration",
        nargs="?",
        type=path_named,
        help="calibration.toml of a design (default: every calibration the ECU accepts)",
    )
    add_choices(parser, ("stage",))
    add_json(parser)


def whole_number(text: str) -> int:
    """Read an integer in any notation of Python."""
    return int(text, 0)


def export_c(parser: Parser) -> None:
    """Export the controller as C99 with test vectors."""
    parser.add_argument("folder", type=Path, help="folder of the bundle")
    add_choices(parser, OF_AN_EXPORT)
    add_choices(parser, ("dbc", "map"))
    parser.add_argument(
        "--elf",
        type=Path,
        help="only write the addresses of this image to the A2L in DIR; with --calibration also "
        "write the calibration at its address, as Intel HEX and S-record",
    )
    parser.add_argument(
        "--address",
        type=whole_number,
        metavar="ADDRESS",
        help="also write the calibration for this address, as Intel HEX and S-record",
    )
    parser.add_argument(
        "--byte-order",
        choices=BYTE_ORDERS,
        help="of the target's memory, for canroll.a2l and --address (default: little; an image "
        "says its own); the C code suits both",
    )
    parser.add_argument(
        "--specialise",
        action="store_true",
        help="code for this calibration alone: smaller, faster, nothing to tune",
    )
    parser.add_argument(
        "--prefix",
        metavar="NAME",
        default=DEFAULT,
        excludes={"elf": "the bundle has its own"},
        help="of all public symbols, macros and files, for several bundles in one image "
        "(default: %(default)s)",
    )
    add_services(parser)
    parser.add_argument(
        "--nvm",
        action="store_true",
        help="with functions that save faults and learnt offsets over a loss of power",
    )
    compiled_in = Relations(excludes={"specialise": "--specialise has the calibration compiled in"})
    parser.relate(compiled_in, "elf", "address", *SERVICES, "nvm")
    parser.relate(Relations(excludes={"elf": "the image says its own"}), "address", "byte_order")
