"""The options of the programs in real time: both together, the ECU alone, the plant alone."""

import argparse
from pathlib import Path

from canroll.cli.options import (
    PACES,
    add_answer,
    add_choices,
    add_recording,
    add_scenario,
    add_section,
    add_services,
    path_named,
)
from canroll.cli.parser import Parser, Relations
from canroll.setup.choices import CHOICES
from codegen.run import SERVICES
from hil.hardware.bus_options import add_bus_arguments

OF_AN_ECU = ("calibration", "stage", "backend", "bus", "dbc", "map", "key")
"""Choices of an ECU: what it runs, and the frames of its bus."""
PEER_TIMEOUT = {"realtime": 0.8, "lockstep": 60.0}
"""Silence after which the other side is taken to be gone, s: in lock step it may be slow."""
DEFAULT_PHASE_MS = 2.0
FREE = "free"
DEFAULT_SERVE = "127.0.0.1:29536"
"""Address of the plant's own bus."""
WORLD = tuple(name for name, choice in CHOICES.items() if choice.of == "world")
"""Choices of a run that concern the plant."""
ON_A_BUS, TRACE, DRIVE = "bus", "trace", "drive"
"""What the ECU of ``canroll ecu`` runs on: a bus, a trace of --trace, or a bus log."""


def hil(parser: Parser) -> None:
    """Run ECU and plant as two processes in real time."""
    parser.description = (
        "Drive a manoeuvre in real time, with ECU and vehicle as separate programs."
    )
    add_scenario(parser)
    add_bus_arguments(parser)
    parser.add_argument(
        "--serve",
        metavar="HOST:PORT",
        help="without -i: address of the plant's bus, for 'canroll watch' (default: a free port)",
    )
    add_choices(parser)
    parser.add_argument(
        "--passive",
        choices=("virtual", "hil"),
        default="virtual",
        help="how the run without control is made (default: %(default)s time)",
    )
    parser.add_argument(
        "--pace",
        choices=PACES,
        default="realtime",
        help="lockstep: the plant grants the ECU's ticks, with the same result on any machine "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="duration; any time after the manoeuvre counts only for the timing",
    )
    add_recording(parser)
    add_answer(parser, "report, traces, …")
    add_prepare_option(parser)


def ecu(parser: Parser) -> None:
    """The ECU alone, on any python-can interface."""
    parser.description = "Run the roll controller in real time against a vehicle on a CAN bus."
    add_bus_arguments(parser)
    add_choices(parser, OF_AN_ECU)
    parser.add_argument("--duration", type=float, metavar="S", help="default: until stopped")
    add_loop_options(parser)
    phase = CHOICES["phase_ms"]
    parser.add_argument(
        phase.option,
        dest=phase.name,
        type=lambda text: FREE if text == FREE else phase.read(text),
        metavar="MS",
        help="time from the earliest arrival of an Imu frame to a tick, 'free': by the ECU's clock "
        f"(default: {DEFAULT_PHASE_MS:g})",
    )
    parser.add_argument("--trace", type=Path, metavar="FILE", help="write the trace of all ticks")
    parser.add_argument(
        "--replay",
        type=Path,
        metavar="FILE",
        help="replay a trace of --trace and compare; or run through a bus log (.mf4 .blf .asc …), "
        "open loop",
    )
    parser.add_argument(
        "--fitted",
        metavar="FILE",
        help="vehicle of 'canroll fit', to compare with what the ECU identified (default: that of "
        "the calibration)",
    )
    add_section(parser)
    add_answer(parser, "the page of a bus log")
    add_services(parser)
    add_memory(parser)
    parser.relate(
        Relations(only=(DRIVE,), outside=": it belongs to --replay of a bus log: omit it"),
        *("section", "out", "json", "fitted"),
    )
    parser.relate(Relations(only=(ON_A_BUS, DRIVE)), "calibration", "channel")
    parser.relate(Relations(only=(ON_A_BUS, TRACE)), *SERVICES)
    parser.relate(
        Relations(only=(ON_A_BUS,)),
        *("interface", "bitrate", "fd", "data_bitrate", "bus_kwargs", "timing", "duration"),
        *("phase_ms", "trace", "pace", "peer_timeout", "cpu", "memory"),
    )
    parser.relate(
        Relations(
            excludes={
                "pace=lockstep": "in lock step the plant grants the ticks: give it to "
                "'canroll plant'"
            }
        ),
        "phase_ms",
    )
    parser.relate(
        Relations(excludes={"pace=lockstep": "a tool does not wait for grants"}), *SERVICES
    )


def plant(parser: Parser) -> None:
    """The vehicle alone, on any python-can interface."""
    parser.description = "Simulate the vehicle in real time for an ECU on a CAN bus."
    add_scenario(parser)
    add_bus_arguments(parser)
    parser.add_argument(
        "--serve",
        metavar="HOST:PORT",
        default=DEFAULT_SERVE,
        help="without -i: address of the plant's bus, for -i socketcand (default: %(default)s);"
        " a bus with CAN FD frames has none",
    )
    add_choices(parser, (*WORLD, "phase_ms", "duration"))
    parser.add_argument(
        "--command",
        dest="command_message",
        metavar="MESSAGE",
        help="command message of the actuators, if they accept several",
    )
    parser.add_argument(
        "--passive", action="store_true", help="the actuators acknowledge but deliver no force"
    )
    parser.add_argument(
        "--wait",
        type=float,
        default=60.0,
        metavar="S",
        help="time to wait for the first frame of the ECU, 0: start at once (default: %(default)g)",
    )
    add_loop_options(parser)
    add_prepare_option(parser)
    add_recording(parser)
    parser.add_argument("--record", type=Path, metavar="FILE", help=argparse.SUPPRESS)
    add_memory(parser)
    parser.relate(
        Relations(excludes={"interface": "it is of the plant's own bus, not of -i"}), "serve"
    )
    parser.relate(
        Relations(needs=("pace=lockstep",), why="--pace lockstep, in real time to 'canroll ecu'"),
        "phase_ms",
    )


def watch(parser: Parser) -> None:
    """Watch the roll controller from the bus."""
    parser.description = "Show mode, roll, moments, trigger rate, bus load and fault codes."
    add_bus_arguments(parser)
    parser.add_argument("--duration", type=float, metavar="S", help="default: until Ctrl-C")
    parser.add_argument(
        "--json", action="store_true", help="no display; print one JSON object at the end"
    )


def add_memory(parser: Parser) -> None:
    """Add the memory that lasts from one start to the next."""
    parser.add_argument(
        "--memory",
        type=path_named,
        metavar="FILE",
        help="authenticated frames: file that counts the starts of this program and of the senders "
        "it hears, made where there is none (default: each start is the first)",
    )


def add_loop_options(parser: Parser) -> None:
    """Add the options that the loops of ECU and plant share."""
    parser.add_argument(
        "--pace",
        choices=PACES,
        default="realtime",
        help="lockstep: the plant grants each tick, as fast as both can (default: %(default)s)",
    )
    parser.add_argument(
        "--peer-timeout",
        type=float,
        metavar="S",
        help="end after this silence of the other side, 0: keep waiting "
        "(default: {realtime:g}, in lock step {lockstep:g})".format(**PEER_TIMEOUT),
    )
    parser.add_argument(
        "--cpu",
        excludes={"pace=lockstep": "in lock step no core is chosen"},
        type=int,
        metavar="N",
        help="core to run on",
    )


def add_prepare_option(parser: Parser) -> None:
    """Add the option to compile the kernels only."""
    parser.add_argument(
        "--prepare",
        action="store_true",
        help="only compile the functions of the run into the cache; no bus is opened",
    )
