"""The options of ``canroll bus``."""

from pathlib import Path
from typing import Any

from canroll.cli.options import JSON, SECTION, choices
from canroll.cli.parser import Parser, flag, opt, related
from canroll.network import COMMANDS, SENSOR
from canroll.plant_sim.can_bus.servers import SOCKETCAND_PORT

LOG, NETWORK, SET, DATABASE = "bus log", "network", "traffic set", "database"
"""What FILE of ``canroll bus`` can be."""
ANALYSED: dict[str, Any] = {"excludes": {"serve": "a served bus is not analysed"}}
OF_A_SET: dict[str, Any] = {
    "only": (SET, DATABASE),
    "outside": " needs a traffic set: {file} is a {mode}",
}
WITH_A_RATE: dict[str, Any] = {
    "only": (LOG, SET, DATABASE),
    "outside": " is that of the network: set it in {file}",
}


def bus(parser: Parser) -> None:
    """Bus load, response times and a bus server."""
    parser.take(
        "Compare worst-case and simulated response times of a traffic set, or of all segments of a "
        "network; or infer a set from a bus log and bound its response times without and with "
        "canroll's messages.",
        opt("file", Path, "FILE", "traffic set, .toml, .dbc, .kcd, .arxml or .sym; network, .toml "
            "or the name of a bus; or bus log; one of several buses or channels: FILE#NAME; with "
            "the bit rate of a log: LOG@RATE"),
        choices(("dbc", "map")),
        opt("-b --bitrate", int, "B", "bit rate, bit/s; default: that of the file; of a log "
            "it has to be given", **WITH_A_RATE),
        opt("--data-bitrate", int, "B", "data bit rate of FD frames, bit/s; default: that of the "
            "file; of a log likewise", **WITH_A_RATE),
        opt("--period", float, "MS", "period of the messages of a database that have no cycle "
            "time; default: left out", only=(DATABASE,),
            outside=" is of messages without a cycle time: {file} is a {mode}"),
        opt("--simulate", float, "S", "simulated time in s, 0: no simulation (default: "
            "%(default)g)", 10.0, **ANALYSED),
        opt("--seed", int, None, "seed of payloads and jitter (default: 0)", 0),
        flag("--worst-case-lengths", "simulate every frame with the maximum number of stuff bits",
             **ANALYSED),
        opt("--xcp", int, "N", "on a network: the ECU also sends N frames of measurements by XCP "
            "in every tick", only=(NETWORK,),
            outside=" requires a network or the name of a bus, such as 500k"),
        opt("--error-interval", float, "MS", "include one disturbed frame every MS milliseconds in "
            "the bounds", **ANALYSED),
        flag("--offsets", "take the offsets between the messages of a node into account in the "
             "bounds", **OF_A_SET, **ANALYSED),
        opt("--replay", Path, "LOG", "replay a bus log (.asc .blf .log …) with the set, except for "
            "identifiers of the set; bounds are then not valid", **OF_A_SET),
        opt("--add", Path, "FILE", "with a log: traffic set to add to its bus; default: canroll's "
            "own messages", only=(LOG,),
            outside=" puts messages onto the bus of a log, {file} is none"),
        opt("--channel", str, None, "channel of a log, as named by python-can; default: all, of "
            "--replay one", only=(LOG,),
            outside=" selects a channel of a log: --replay is required"),
        SECTION,
        related("section",
                only=(LOG,), outside=" selects a section of a log: --replay is required"),
        opt("--sensor", str, None, "sensor message (default: %(default)s)", SENSOR, **ANALYSED),
        opt("--command", str, None, f"command message (default: the first of {', '.join(COMMANDS)} "
            "that is there)", **ANALYSED),
        opt("--tick", float, "MS", "control tick (default: 10)", 10.0, **ANALYSED),
        opt("--serve", int, "PORT", "run the traffic in real time, for python-can with "
            f"interface=socketcand (default port: {SOCKETCAND_PORT})", nargs="?",
            const=SOCKETCAND_PORT, **OF_A_SET,
            excludes={"replay": "--serve and --replay exclude each other"}),
        opt("--host", str, None, "with --serve (default: %(default)s)", "127.0.0.1",
            needs=("serve",)),
        JSON,
        related("json", **ANALYSED),
    )  # fmt: skip
