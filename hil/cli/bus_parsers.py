"""The options of the programs on a bus: both together, the ECU alone, the plant alone."""

import argparse
from pathlib import Path

from hil.cli.options import (
    DEFAULT_SCENARIO,
    OF_A_RUN,
    add_answer,
    add_choices,
    add_execution,
    add_numbers,
    add_recording,
    add_scenario,
    add_services,
    path_named,
    scenario,
)
from hil.network import COMMANDS, SENSOR
from hil.realtime.bus_link import add_bus_arguments
from hil.runs.choices import CHOICES
from plant_sim.can_bus.servers.shared_server import DEFAULT_PORT as SHARED_PORT
from plant_sim.can_bus.servers.socketcand import DEFAULT_PORT

OF_AN_ECU = ("calibration", "stage", "backend", "bus", "dbc", "map", "key")
"""Choices of an ECU: what it runs, and the frames of its bus."""
PACES = ("realtime", "lockstep")
PEER_TIMEOUT = {"realtime": 0.8, "lockstep": 60.0}
"""Silence after which the other side is taken to be gone, s: in lock step it may be slow."""
DEFAULT_PHASE_MS = 2.0
PROPOSALS = ("priorities", "offsets")
FREE = "free"
DEFAULT_SERVE = "127.0.0.1:29536"
"""Address of the plant's own bus."""
WORLD = tuple(name for name, choice in CHOICES.items() if choice.of == "world")
"""Choices of a run that concern the plant."""


def bus(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll bus``."""
    parser.description = (
        "Compare worst-case and simulated response times of a traffic set, or of all segments of a "
        "network; or infer a set from a bus log and bound its response times without and with "
        "canroll's messages."
    )
    parser.add_argument(
        "file",
        metavar="FILE",
        type=Path,
        help="traffic set, .toml, .dbc, .kcd, .arxml or .sym; network, .toml or the name of a bus; "
        "or bus log; one of several buses or channels: FILE#NAME; with the bit rate of a log: "
        "LOG@RATE",
    )
    add_choices(parser, ("dbc", "map"))
    parser.add_argument(
        "-b",
        "--bitrate",
        type=int,
        metavar="B",
        help="bit rate, bit/s; default: that of the file, of a log: inferred or assumed",
    )
    parser.add_argument(
        "--data-bitrate",
        type=int,
        metavar="B",
        help="data bit rate of FD frames, bit/s; default: that of the file, of a log: inferred or "
        "assumed",
    )
    parser.add_argument(
        "--period",
        type=float,
        metavar="MS",
        help="period of the messages of a database that have no cycle time; default: left out",
    )
    parser.add_argument(
        "--simulate",
        type=float,
        default=10.0,
        metavar="S",
        help="simulated time in s, 0: no simulation (default: %(default)g)",
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of payloads and jitter (default: 0)"
    )
    parser.add_argument(
        "--worst-case-lengths",
        action="store_true",
        help="simulate every frame with the maximum number of stuff bits",
    )
    parser.add_argument(
        "--xcp",
        type=int,
        metavar="N",
        help="on a network: the ECU also sends N frames of measurements by XCP in every tick",
    )
    parser.add_argument(
        "--error-interval",
        type=float,
        metavar="MS",
        help="include one disturbed frame every MS milliseconds in the bounds",
    )
    parser.add_argument(
        "--offsets",
        action="store_true",
        help="take the offsets between the messages of a node into account in the bounds",
    )
    parser.add_argument(
        "--sensitivity",
        action="store_true",
        help="greatest factor on the rate of all messages with which every deadline is met",
    )
    parser.add_argument(
        "--errors-per-second",
        type=float,
        metavar="R",
        help="probability of a missed deadline with R random errors a second (Poisson)",
    )
    parser.add_argument(
        "--propose",
        choices=PROPOSALS,
        help="identifiers that meet all deadlines (Audsley), or offsets that spread the"
        " messages of each node",
    )
    parser.add_argument(
        "--replay",
        type=Path,
        metavar="LOG",
        help="replay a bus log (.asc .blf .log …) with the set, except for identifiers of the set;"
        " bounds are then not valid",
    )
    parser.add_argument(
        "--add",
        type=Path,
        metavar="FILE",
        help="with a log: traffic set to add to its bus; default: canroll's own messages",
    )
    parser.add_argument(
        "--channel", help="channel of a log, as named by python-can; default: all, of --replay one"
    )
    add_section(parser)
    parser.add_argument("--sensor", default=SENSOR, help="sensor message (default: %(default)s)")
    parser.add_argument(
        "--command",
        help=f"command message (default: the first of {', '.join(COMMANDS)} that is there)",
    )
    parser.add_argument(
        "--tick", type=float, default=10.0, metavar="MS", help="control tick (default: 10)"
    )
    parser.add_argument(
        "--serve",
        nargs="?",
        type=int,
        const=DEFAULT_PORT,
        metavar="PORT",
        help="run the traffic in real time, for python-can with interface=socketcand"
        f" (default port: {DEFAULT_PORT})",
    )
    parser.add_argument(
        "--share",
        nargs="?",
        type=int,
        const=SHARED_PORT,
        metavar="PORT",
        help="share the bus with --programs in lock step, for python-can with"
        f" interface=simbus_shared (default port: {SHARED_PORT})",
    )
    parser.add_argument(
        "--programs", type=int, metavar="N", help="with --share: programs to wait for"
    )
    parser.add_argument(
        "--pace",
        choices=PACES,
        default="lockstep",
        help="with --share; realtime: no faster than the clock (default: %(default)s)",
    )
    parser.add_argument(
        "--mirror",
        metavar="INTERFACE:CHANNEL",
        help="with --share: every frame also goes to a bus of python-can, such as socketcan:vcan0",
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="with --serve and --share (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def hil(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll hil``."""
    parser.description = (
        "Drive a manoeuvre in real time, with ECU and vehicle as separate programs."
    )
    parser.add_argument(
        "scenario", nargs="?", type=scenario, help="double_lane_change, roundabout, …"
    )
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
        "--side-channel",
        nargs="?",
        const="127.0.0.1:0",
        metavar="HOST:PORT",
        help="lock step: grants on a TCP connection instead of 29-bit frames on the bus",
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
    parser.add_argument(
        "--check",
        action="store_true",
        help="measure for --duration S (default: 10) whether this machine can keep the tick",
    )


def ecu(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll ecu``."""
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
    add_section(parser)
    add_answer(parser, "the page of a bus log")
    add_services(parser)
    add_memory(parser)


def plant(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll plant``."""
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


def attacks(parser: argparse.ArgumentParser) -> None:
    """Options of ``canroll attacks``."""
    parser.description = (
        "Drive a manoeuvre with an attacker on the bus: spoofed, replayed, damaged and foreign "
        "frames, floods, and resets of nodes; on 500k and on secured_fd, or on --bus; with -i over "
        "that interface, in lock step. Exit code 1 if a forged frame is accepted on a bus "
        "with authenticated frames."
    )
    add_scenario(parser, DEFAULT_SCENARIO)
    add_choices(
        parser,
        [name for name in OF_A_RUN if name not in ("faults", "fault_file", "duration")],
        defaults={"bus": None},
    )
    parser.add_argument(
        "--attack", metavar="TEXT", default="", help="only attacks whose name contains TEXT"
    )
    add_bus_arguments(parser)
    parser.set_defaults(serve=None)
    add_execution(parser, "attack")
    add_numbers(parser)


def add_section(parser: argparse.ArgumentParser) -> None:
    """Add the choice among the sections of a log whose times step."""
    parser.add_argument(
        "--section",
        type=int,
        metavar="N",
        help="section of a log whose times step, by a clock that was set or a pause of more than a "
        "minute (default: that with most frames)",
    )


def add_memory(parser: argparse.ArgumentParser) -> None:
    """Add the memory that lasts from one start to the next."""
    parser.add_argument(
        "--memory",
        type=path_named,
        metavar="FILE",
        help="authenticated frames: file that counts the starts of this program and of the senders "
        "it hears, made where there is none (default: each start is the first)",
    )


def add_loop_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that the loops of ECU and plant share."""
    parser.add_argument(
        "--pace",
        choices=PACES,
        default="realtime",
        help="lockstep: the plant grants each tick, as fast as both can (default: %(default)s)",
    )
    parser.add_argument(
        "--side-channel",
        metavar="HOST:PORT",
        help="lock step: grants on a TCP connection instead of 29-bit frames on the bus",
    )
    parser.add_argument(
        "--peer-timeout",
        type=float,
        metavar="S",
        help="end after this silence of the other side, 0: keep waiting "
        "(default: {realtime:g}, in lock step {lockstep:g})".format(**PEER_TIMEOUT),
    )
    parser.add_argument("--cpu", type=int, metavar="N", help="core to run on")


def add_prepare_option(parser: argparse.ArgumentParser) -> None:
    """Add the option to compile the kernels only."""
    parser.add_argument(
        "--prepare",
        action="store_true",
        help="only compile the functions of the run into the cache; no bus is opened",
    )
