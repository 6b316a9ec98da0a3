"""The options of the commands that measure a vehicle."""

from argparse import RawDescriptionHelpFormatter
from math import inf
from typing import Any

from canroll.cli.options import (
    add_answer,
    add_choices,
    add_execution,
    add_json,
    key_value,
    not_empty,
    path_named,
)
from canroll.cli.parser import Parser

AXES = ("iso", "sae", "adapted-sae")
"""Axes of a tyre's table, keys of :data:`canroll.extensions.car.tyres.measured.AXES`."""


def vehicle(parser: Parser) -> None:
    """A vehicle file from mass and size; a vehicle beside its class; a tyre file from a table."""
    from canroll.extensions.car.sizing.classes import CLASSES, RATIOS  # noqa: PLC0415 - numpy

    parser.formatter_class = RawDescriptionHelpFormatter
    parser.description = (
        "new: write a complete vehicle file from mass and size; what is not given is\n"
        "     estimated by the class, with its spread.\n"
        "check: compare a vehicle with its class.\n"
        "tyre: fit a tyre file (.tir) to a measured table of slip angle, load, camber\n"
        "      and lateral force."
    )
    rows = [("RATIO", *CLASSES)]
    rows += [(name, *(str(getattr(each, name)) for each in CLASSES.values())) for name in RATIOS]
    parser.epilog_of = "set"
    parser.epilog = "usual values, with their spread:\n" + "\n".join(
        "  " + "".join(f"{word:<18}" for word in row).rstrip() for row in rows
    )
    parser.add_argument(
        "what", choices=("new", "check", "tyre"), metavar="ACTION", help="new, check or tyre"
    )
    parser.add_argument(
        "vehicle",
        metavar="FILE",
        help="vehicle file; for check also a preset; for tyre the table, a CSV file",
    )
    parser.add_argument(
        "--class",
        needs=("what=new", "what=check"),
        why="canroll vehicle new and check",
        dest="kind",
        metavar="CLASS",
        help="car, suv or van",
    )
    parser.add_argument(
        "--drive",
        needs=("what=new", "what=check"),
        why="canroll vehicle new and check",
        metavar="AXLES",
        help="driven axles, front, rear or all, on which the front share of the weight depends",
    )
    new: dict[str, Any] = {"needs": ("what=new",), "why": "canroll vehicle new"}
    for name, unit, meaning in (
        ("mass", "KG", "of the vehicle, with driver and load"),
        ("wheelbase", "M", "distance between the axles"),
        ("track", "M", "mean of both axles"),
        ("height", "M", "of the vehicle, from the road to its roof"),
    ):
        parser.add_argument(f"--{name}", type=float, metavar=unit, help=meaning, **new)
    parser.add_argument(
        "--set",
        **new,
        action="append",
        type=key_value,
        metavar="RATIO=VALUE",
        help="a known ratio of the class, such as front_share=0.55; may be repeated",
    )
    tyre: dict[str, Any] = {"needs": ("what=tyre",), "why": "canroll vehicle tyre"}
    parser.add_argument("--out", **tyre, metavar="TYRE.tir", help="tyre file to write, and .png")
    parser.add_argument(
        "--from",
        **tyre,
        dest="start",
        metavar="START.tir",
        help="tyre file where the fit starts, of which all that is not fitted stays",
    )
    parser.add_argument(
        "--axes",
        **tyre,
        choices=AXES,
        default=AXES[0],
        help="axes of the table: ISO 8855, SAE J670, or SAE adapted by Pacejka (default: "
        "%(default)s)",
    )
    parser.add_argument(
        "--radius",
        **tyre,
        type=float,
        metavar="M",
        help="unloaded radius (default: of START.tir, else guessed)",
    )
    add_json(parser)


def fit(parser: Parser) -> None:
    """A vehicle's numbers from a measured drive."""
    parser.description = (
        "Fit the numbers of a vehicle to a measured drive: the 14-DOF car is steered as measured, "
        "and its numbers are changed until it moves as measured. Says how sure each is, and what "
        "the log cannot tell."
    )
    parser.add_argument("log", type=not_empty, metavar="LOG", help=".csv .mat .mf4, or a bus log")
    add_choices(parser, ("vehicle",), defaults={"vehicle": None})  # required
    _add_measured(parser, "fit")
    parser.add_argument("--check", metavar="FROM:TO", help="part (s) to predict with the fit")
    parser.add_argument(
        "--actuator",
        choices=("bars", "suspension"),
        default="",
        help="actuators whose moments the log has (default: bars; of corner forces, suspension)",
    )
    for name, meaning in (
        ("free", "fit this number though its source says that it is known"),
        ("hold", "hold this number"),
    ):
        parser.add_argument(
            f"--{name}", action="append", metavar="KEY", help=f"{meaning}; may be repeated"
        )
    parser.add_argument(
        "--starts",
        type=int,
        default=3,
        metavar="N",
        help="searches from different numbers, up to four times as many where none is confirmed "
        "(default: %(default)s)",
    )
    add_execution(parser, "start", "scheduler", "resume", "only")
    add_answer(parser, "vehicle, page and covariance")


def _add_measured(parser: Parser, verb: str) -> None:
    """Add the options of how a measured drive is read, and which part of it."""
    parser.add_argument(
        "--signal",
        action="append",
        type=not_empty,
        metavar="QUANTITY=[-]NAME[:UNIT]",
        help="signal of the log that is a quantity: time, steering, speed, yaw_rate, "
        "lateral_acceleration, roll_rate, roll, sideslip, travel_front_left, delivered_front, "
        "commanded_front, commanded_force_front_left, …; - reverses it, UNIT may be 16*rad, "
        "without NAME it is left out; may be repeated",
    )
    parser.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help="samples per second of a log without a column of times",
    )
    parser.add_argument(
        "--dbc", default="", metavar="FILE", help="network description of a bus log"
    )
    parser.add_argument(
        "--map", default="", metavar="FILE", help="map of its signals to the ECU's fields"
    )
    parser.add_argument(
        "--imu",
        choices=("body", "levelled"),
        default="body",
        help="axes of the inertial unit: the body's, or levelled, without gravity (default: body)",
    )
    parser.add_argument(
        "--from",
        dest="begin",
        type=float,
        default=-inf,
        metavar="S",
        help=f"{verb} from this time on",
    )
    parser.add_argument("--to", dest="end", type=float, default=inf, metavar="S", help="up to this")


def validate(parser: Parser) -> None:
    """A verdict on a vehicle by measured drives."""
    parser.description = (
        "Judge a vehicle by measured drives: the 14-DOF car is steered as measured, and every "
        "signal is rated (ISO/TS 18571). Of a steady circle, a step steer, a sine sweep and a sine "
        "with dwell the figures of their standards are compared too. Exit code 1 if anything is "
        "not good enough."
    )
    parser.add_argument(
        "logs", nargs="+", type=not_empty, metavar="LOG", help=".csv .mat .mf4, or bus logs"
    )
    add_choices(parser, ("vehicle",), defaults={"vehicle": None})  # required
    _add_measured(parser, "compare")
    parser.add_argument(
        "--manoeuvre",
        default="",
        metavar="NAME",
        help="steady_circle, step_steer, sine_sweep, sine_with_dwell or free (default: recognised "
        "by the steering)",
    )
    parser.add_argument(
        "--zero",
        excludes={"measurement": "--measurement has the offsets"},
        metavar="FROM:TO",
        help="part (s) of straight driving, whose means are the offsets of all signals",
    )
    parser.add_argument(
        "--measurement",
        type=path_named,
        metavar="FILE",
        help="fit.json of 'canroll fit', whose offsets and delays are those of the log",
    )
    parser.add_argument(
        "--rating",
        type=float,
        default=0.80,
        metavar="R",
        help="least rating of a signal by ISO/TS 18571 (default: %(default)s)",
    )
    parser.add_argument(
        "--explained",
        action="append",
        type=key_value,
        metavar="SIGNAL=SHARE",
        help="least share of a signal's variance that is accounted for (default: yaw_rate 0.995, "
        "lateral_acceleration 0.98, roll_rate 0.93, others 0.94); may be repeated",
    )
    parser.add_argument(
        "--error",
        type=float,
        default=inf,
        metavar="SHARE",
        help="largest RMS of a difference over the largest measured value (default: no limit)",
    )
    parser.add_argument(
        "--tolerance",
        action="append",
        type=key_value,
        metavar="NAME=OFFSET:GAIN",
        help="tolerance of figures of a manoeuvre, OFFSET plus GAIN times the value, such as "
        "circle.roll=0.2:0.05; may be repeated",
    )
    add_answer(parser, "page and numbers")
