"""The options of the programs on a bus: both together, the ECU alone, the plant alone."""

import argparse
from pathlib import Path

from canroll.cli.options import (
    DEFAULT_SCENARIO,
    OF_A_RUN,
    add_answer,
    add_choices,
    add_execution,
    add_json,
    add_numbers,
    add_recording,
    add_scenario,
    add_services,
    path_named,
    scenario,
)
from canroll.cli.parser import Parser, Relations
from canroll.network import COMMANDS, SENSOR
from canroll.setup.choices import CHOICES
from codegen.run import SERVICES
from hil.bus_link import add_bus_arguments
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
LOOPBACK = "127.0.0.1"
DEFAULT_SERVE = f"{LOOPBACK}:29536"
"""Address of the plant's own bus."""
WEB_PORT = 8029
"""Port of the page of ``canroll watch``."""
WORLD = tuple(name for name, choice in CHOICES.items() if choice.of == "world")
"""Choices of a run that concern the plant."""


LOG, NETWORK, SET, DATABASE = "bus log", "network", "traffic set", "database"
"""What FILE of ``canroll bus`` can be."""
OF_A_SET = (SET, DATABASE)
WITH_A_RATE = (LOG, SET, DATABASE)
NEEDS_A_SET = " needs a traffic set: {file} is a {mode}"
SERVED = dict.fromkeys(("serve", "share"), "a served bus is not analysed")


def bus(parser: Parser) -> None:
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
        only=WITH_A_RATE,
        outside=" is that of the network: set it in {file}",
        type=int,
        metavar="B",
        help="bit rate, bit/s; default: that of the file, of a log: inferred or assumed",
    )
    parser.add_argument(
        "--data-bitrate",
        only=WITH_A_RATE,
        outside=" is that of the network: set it in {file}",
        type=int,
        metavar="B",
        help="data bit rate of FD frames, bit/s; default: that of the file, of a log: inferred or "
        "assumed",
    )
    parser.add_argument(
        "--period",
        only=(DATABASE,),
        outside=" is of messages without a cycle time: {file} is a {mode}",
        type=float,
        metavar="MS",
        help="period of the messages of a database that have no cycle time; default: left out",
    )
    parser.add_argument(
        "--simulate",
        excludes=SERVED,
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
        excludes=SERVED,
        action="store_true",
        help="simulate every frame with the maximum number of stuff bits",
    )
    parser.add_argument(
        "--xcp",
        only=(NETWORK,),
        outside=" requires a network or the name of a bus, such as 500k",
        type=int,
        metavar="N",
        help="on a network: the ECU also sends N frames of measurements by XCP in every tick",
    )
    parser.add_argument(
        "--error-interval",
        excludes=SERVED,
        type=float,
        metavar="MS",
        help="include one disturbed frame every MS milliseconds in the bounds",
    )
    parser.add_argument(
        "--offsets",
        only=OF_A_SET,
        outside=NEEDS_A_SET,
        excludes=SERVED,
        action="store_true",
        help="take the offsets between the messages of a node into account in the bounds",
    )
    parser.add_argument(
        "--sensitivity",
        only=OF_A_SET,
        outside=NEEDS_A_SET,
        excludes=SERVED,
        action="store_true",
        help="greatest factor on the rate of all messages with which every deadline is met",
    )
    parser.add_argument(
        "--errors-per-second",
        only=OF_A_SET,
        outside=NEEDS_A_SET,
        excludes=SERVED,
        type=float,
        metavar="R",
        help="probability of a missed deadline with R random errors a second (Poisson)",
    )
    parser.add_argument(
        "--propose",
        only=OF_A_SET,
        outside=NEEDS_A_SET,
        excludes=SERVED,
        choices=PROPOSALS,
        help="identifiers that meet all deadlines (Audsley), or offsets that spread the"
        " messages of each node",
    )
    parser.add_argument(
        "--replay",
        only=OF_A_SET,
        outside=NEEDS_A_SET,
        type=Path,
        metavar="LOG",
        help="replay a bus log (.asc .blf .log …) with the set, except for identifiers of the set;"
        " bounds are then not valid",
    )
    parser.add_argument(
        "--add",
        only=(LOG,),
        outside=" puts messages onto the bus of a log, {file} is none",
        type=Path,
        metavar="FILE",
        help="with a log: traffic set to add to its bus; default: canroll's own messages",
    )
    parser.add_argument(
        "--channel",
        only=(LOG,),
        outside=" selects a channel of a log: --replay is required",
        help="channel of a log, as named by python-can; default: all, of --replay one",
    )
    add_section(parser)
    parser.relate(
        Relations(only=(LOG,), outside=" selects a section of a log: --replay is required"),
        "section",
    )
    parser.add_argument(
        "--sensor", excludes=SERVED, default=SENSOR, help="sensor message (default: %(default)s)"
    )
    parser.add_argument(
        "--command",
        excludes=SERVED,
        help=f"command message (default: the first of {', '.join(COMMANDS)} that is there)",
    )
    parser.add_argument(
        "--tick",
        excludes=SERVED,
        type=float,
        default=10.0,
        metavar="MS",
        help="control tick (default: 10)",
    )
    parser.add_argument(
        "--serve",
        only=OF_A_SET,
        outside=NEEDS_A_SET,
        excludes={
            "share": "--share has its own server",
            "replay": "--serve and --replay exclude each other",
        },
        nargs="?",
        type=int,
        const=DEFAULT_PORT,
        metavar="PORT",
        help="run the traffic in real time, for python-can with interface=socketcand"
        f" (default port: {DEFAULT_PORT})",
    )
    parser.add_argument(
        "--share",
        only=OF_A_SET,
        outside=NEEDS_A_SET,
        needs=("programs",),
        nargs="?",
        type=int,
        const=SHARED_PORT,
        metavar="PORT",
        help="share the bus with --programs in lock step, for python-can with"
        f" interface=simbus_shared (default port: {SHARED_PORT})",
    )
    parser.add_argument(
        "--programs",
        needs=("share",),
        type=int,
        metavar="N",
        help="with --share: programs to wait for",
    )
    parser.add_argument(
        "--pace",
        needs=("share",),
        choices=PACES,
        default="lockstep",
        help="with --share; realtime: no faster than the clock (default: %(default)s)",
    )
    parser.add_argument(
        "--mirror",
        needs=("share",),
        metavar="INTERFACE:CHANNEL",
        help="with --share: every frame also goes to a bus of python-can, such as socketcan:vcan0",
    )
    parser.add_argument(
        "--host",
        needs=("serve", "share"),
        default="127.0.0.1",
        help="with --serve and --share (default: %(default)s)",
    )
    add_json(parser)
    parser.relate(Relations(excludes=SERVED), "json")


def hil(parser: Parser) -> None:
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
    no_run = Relations(excludes={"check": "--check drives no manoeuvre"})
    parser.relate(no_run, "serve", "pace", "passive")
    parser.relate(Relations(excludes={"check": "--check writes no files"}), "out", "log", "signals")


ON_A_BUS, TRACE, DRIVE = "bus", "trace", "drive"
"""What the ECU of ``canroll ecu`` runs on: a bus, a trace of --trace, or a bus log."""


def ecu(parser: Parser) -> None:
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
    parser.relate(
        Relations(only=(DRIVE,), outside=": it belongs to --replay of a bus log: omit it"),
        *("section", "out", "json"),
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
    parser.relate(
        Relations(excludes={"interface": "it is of the plant's own bus, not of -i"}), "serve"
    )
    parser.relate(
        Relations(needs=("pace=lockstep",), why="--pace lockstep, in real time to 'canroll ecu'"),
        "phase_ms",
    )


def attacks(parser: Parser) -> None:
    """Options of ``canroll attacks``."""
    parser.description = (
        "Drive a manoeuvre with an attacker on the bus: spoofed, replayed, damaged and foreign "
        "frames, floods, and resets of nodes; on 500k and on secured_fd, or on --bus. "
        "Exit code 1 if a forged frame is accepted on a bus with authenticated frames."
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
    add_execution(parser, "attack")
    add_numbers(parser)


def watch(parser: Parser) -> None:
    """Options of ``canroll watch``."""
    parser.description = "Show mode, roll, moments, trigger rate, bus load and fault codes."
    add_bus_arguments(parser)
    parser.add_argument("--duration", type=float, metavar="S", help="default: until Ctrl-C")
    parser.add_argument(
        "--web", action="store_true", help="live plots in the browser instead of the terminal"
    )
    parser.add_argument(
        "--port",
        needs=("web",),
        type=int,
        metavar="N",
        help=f"port of the page, 0: a free one (default: {WEB_PORT})",
    )
    parser.add_argument(
        "--host",
        needs=("web",),
        metavar="ADDRESS",
        help=f"address on which the page is served (default: {LOOPBACK}, this machine only)",
    )
    parser.add_argument(
        "--json", action="store_true", help="no display; print one JSON object at the end"
    )


def add_section(parser: Parser) -> None:
    """Add the choice among the sections of a log whose times step."""
    parser.add_argument(
        "--section",
        type=int,
        metavar="N",
        help="section of a log whose times step, by a clock that was set or a pause of more than a "
        "minute (default: that with most frames)",
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
