"""The options of the programs in real time: both together, the ECU alone, the plant alone."""

import argparse
from pathlib import Path

from canroll.cli.options import (
    PACES,
    RARE_OF_A_DESIGN,
    RECORDING,
    SECTION,
    answer,
    choices,
    path_named,
    scenario_named,
    service_flags,
    services,
)
from canroll.cli.parser import Parser, flag, opt, related
from canroll.hil.hardware.bus_options import add_bus_arguments
from canroll.setup.choices import CHOICES

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
MEMORY = opt(
    "--memory", path_named, "FILE", "authenticated frames: file that counts the starts of this "
    "program and of the senders it hears, made where there is none (default: each start is the "
    "first)",
)  # fmt: skip
LOOP = (
    opt("--pace", PACES, None, "lockstep: the plant grants each tick, as fast as both can "
        "(default: %(default)s)", "realtime"),
    opt("--peer-timeout", float, "S", "end after this silence of the other side, 0: keep waiting "
        "(default: {realtime:g}, in lock step {lockstep:g})".format(**PEER_TIMEOUT)),
    opt("--cpu", int, "N", "core to run on",
        excludes={"pace=lockstep": "in lock step no core is chosen"}),
)  # fmt: skip
"""Options that the loops of ECU and plant share."""
PREPARE = flag(
    "--prepare", "only compile the functions of the run into the cache; no bus is opened"
)


def _phase(text: str) -> float | str:
    return FREE if text == FREE else float(CHOICES["phase_ms"].read(text))


def hil(parser: Parser) -> None:
    """Run ECU and plant as two processes in real time."""
    parser.take(
        "Drive a manoeuvre in real time, with ECU and vehicle as separate programs.",
        scenario_named(),
        add_bus_arguments,
        opt("--serve", str, "HOST:PORT", "without -i: address of the plant's bus, for 'canroll "
            "watch' (default: a free port)"),
        choices(of_file=RARE_OF_A_DESIGN),
        opt("--passive", ("virtual", "hil"), None, "how the run without control is made (default: "
            "%(default)s time)", "virtual"),
        opt("--pace", PACES, None, "lockstep: the plant grants the ECU's ticks, with the same "
            "result on any machine (default: %(default)s)", "realtime"),
        opt("--duration", float, "S", "duration; any time after the manoeuvre counts only for the "
            "timing"),
        *RECORDING,
        *answer("report, traces, …"),
        PREPARE,
    )  # fmt: skip


def ecu(parser: Parser) -> None:
    """The ECU alone, on any python-can interface."""
    parser.take(
        "Run the roll controller in real time against a vehicle on a CAN bus.",
        add_bus_arguments,
        choices(OF_AN_ECU),
        opt("--duration", float, "S", "default: until stopped"),
        *LOOP,
        opt(CHOICES["phase_ms"].option, _phase, "MS", "time from the earliest arrival of an Imu "
            "frame to a tick, 'free': by the ECU's clock (default: "
            f"{DEFAULT_PHASE_MS:g})", dest="phase_ms"),
        opt("--trace", Path, "FILE", "write the trace of all ticks"),
        opt("--replay", Path, "FILE", "replay a trace of --trace and compare; or run through a bus "
            "log (.mf4 .blf .asc …), open loop"),
        opt("--fitted", str, "FILE", "vehicle of 'canroll fit', to compare with what the ECU "
            "identified (default: that of the calibration)"),
        SECTION,
        *answer("the page of a bus log"),
        *service_flags(services()),
        MEMORY,
        related("section", "out", "json", "fitted",
                only=(DRIVE,), outside=": it belongs to --replay of a bus log: omit it"),
        related("calibration", "channel", only=(ON_A_BUS, DRIVE)),
        related(*services(), only=(ON_A_BUS, TRACE)),
        related(*("interface", "bitrate", "fd", "data_bitrate", "bus_kwargs", "timing", "duration"),
                *("phase_ms", "trace", "pace", "peer_timeout", "cpu", "memory"),
                only=(ON_A_BUS,)),
        related("phase_ms",
                excludes={"pace=lockstep": "in lock step the plant grants the ticks: give it to "
                          "'canroll plant'"}),
        related(*services(), excludes={"pace=lockstep": "a tool does not wait for grants"}),
    )  # fmt: skip


def plant(parser: Parser) -> None:
    """The vehicle alone, on any python-can interface."""
    parser.take(
        "Simulate the vehicle in real time for an ECU on a CAN bus.",
        scenario_named(),
        add_bus_arguments,
        opt("--serve", str, "HOST:PORT", "without -i: address of the plant's bus, for -i "
            "socketcand (default: %(default)s); a bus with CAN FD frames has none", DEFAULT_SERVE),
        choices((*WORLD, "phase_ms", "duration")),
        opt("--command", str, "MESSAGE", "command message of the actuators, if they accept several",
            dest="command_message"),
        flag("--passive", "the actuators acknowledge but deliver no force"),
        opt("--wait", float, "S", "time to wait for the first frame of the ECU, 0: start at once "
            "(default: %(default)g)", 60.0),
        *LOOP,
        PREPARE,
        *RECORDING,
        opt("--record", Path, "FILE", argparse.SUPPRESS),
        MEMORY,
        related("serve", excludes={"interface": "it is of the plant's own bus, not of -i"}),
        related("phase_ms",
                needs=("pace=lockstep",), why="--pace lockstep, in real time to 'canroll ecu'"),
    )  # fmt: skip


def watch(parser: Parser) -> None:
    """Watch the roll controller from the bus."""
    parser.take(
        "Show mode, roll, moments, trigger rate, bus load and fault codes.",
        add_bus_arguments,
        opt("--duration", float, "S", "default: until Ctrl-C"),
        flag("--json", "no display; print one JSON object at the end"),
    )
