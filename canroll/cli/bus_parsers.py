"""The options of ``canroll bus``."""

from pathlib import Path

from canroll.cli.options import add_choices, add_json, add_section
from canroll.cli.parser import Parser, Relations
from canroll.network import COMMANDS, SENSOR
from plant_sim.can_bus.servers import SOCKETCAND_PORT

LOG, NETWORK, SET, DATABASE = "bus log", "network", "traffic set", "database"
"""What FILE of ``canroll bus`` can be."""
OF_A_SET = (SET, DATABASE)
WITH_A_RATE = (LOG, SET, DATABASE)
NEEDS_A_SET = " needs a traffic set: {file} is a {mode}"
SERVED = {"serve": "a served bus is not analysed"}


def bus(parser: Parser) -> None:
    """Bus load, response times and a bus server."""
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
        excludes={"replay": "--serve and --replay exclude each other"},
        nargs="?",
        type=int,
        const=SOCKETCAND_PORT,
        metavar="PORT",
        help="run the traffic in real time, for python-can with interface=socketcand"
        f" (default port: {SOCKETCAND_PORT})",
    )
    parser.add_argument(
        "--host",
        needs=("serve",),
        default="127.0.0.1",
        help="with --serve (default: %(default)s)",
    )
    add_json(parser)
    parser.relate(Relations(excludes=SERVED), "json")
