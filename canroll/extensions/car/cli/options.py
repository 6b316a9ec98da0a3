"""The options of the commands that measure a vehicle."""

from argparse import RawDescriptionHelpFormatter
from math import inf
from typing import Any

from canroll.cli.options import JSON, answer, choices, execution, key_value, not_empty, path_named
from canroll.cli.parser import Option, Parser, opt, repeated

AXES = ("iso", "sae", "adapted-sae")
"""Axes of a tyre's table, keys of :data:`canroll.extensions.car.tyres.measured.AXES`."""
OF_A_CLASS: dict[str, Any] = {
    "needs": ("what=new", "what=check"),
    "why": "canroll vehicle new and check",
}
NEW: dict[str, Any] = {"needs": ("what=new",), "why": "canroll vehicle new"}
TYRE: dict[str, Any] = {"needs": ("what=tyre",), "why": "canroll vehicle tyre"}


def vehicle(parser: Parser) -> None:
    """A vehicle file from mass and size; a vehicle beside its class; a tyre file from a table."""
    from canroll.extensions.car.sizing.classes import CLASSES, RATIOS  # noqa: PLC0415 - numpy

    parser.formatter_class = RawDescriptionHelpFormatter
    rows = [("RATIO", *CLASSES)]
    rows += [(name, *(str(getattr(each, name)) for each in CLASSES.values())) for name in RATIOS]
    parser.epilog_of = "set"
    parser.epilog = "usual values, with their spread:\n" + "\n".join(
        "  " + "".join(f"{word:<18}" for word in row).rstrip() for row in rows
    )
    parser.take(
        "new: write a complete vehicle file from mass and size; what is not given is\n"
        "     estimated by the class, with its spread.\n"
        "check: compare a vehicle with its class.\n"
        "tyre: fit a tyre file (.tir) to a measured table of slip angle, load, camber\n"
        "      and lateral force.",
        opt("what", ("new", "check", "tyre"), "ACTION", "new, check or tyre"),
        opt("vehicle", str, "FILE", "vehicle file; for check also a preset; for tyre the table, a "
            "CSV file"),
        opt("--class", str, "CLASS", "car, suv or van", dest="kind", **OF_A_CLASS),
        opt("--drive", str, "AXLES", "driven axles, front, rear or all, on which the front share "
            "of the weight depends", **OF_A_CLASS),
        opt("--mass", float, "KG", "of the vehicle, with driver and load", **NEW),
        opt("--wheelbase", float, "M", "distance between the axles", **NEW),
        opt("--track", float, "M", "mean of both axles", **NEW),
        opt("--height", float, "M", "of the vehicle, from the road to its roof", **NEW),
        repeated("--set", key_value, "RATIO=VALUE", "a known ratio of the class, such as "
                 "front_share=0.55", **NEW),
        opt("--out", str, "TYRE.tir", "tyre file to write, and .png", **TYRE),
        opt("--from", str, "START.tir", "tyre file where the fit starts, of which all that is not "
            "fitted stays", dest="start", **TYRE),
        opt("--axes", AXES, None, "axes of the table: ISO 8855, SAE J670, or SAE adapted by "
            "Pacejka (default: %(default)s)", AXES[0], **TYRE),
        opt("--radius", float, "M", "unloaded radius (default: of START.tir, else guessed)",
            **TYRE),
        JSON,
    )  # fmt: skip


def fit(parser: Parser) -> None:
    """A vehicle's numbers from a measured drive."""
    parser.take(
        "Fit the numbers of a vehicle to a measured drive: the 14-DOF car is steered as measured, "
        "and its numbers are changed until it moves as measured. Says how sure each is, and what "
        "the log cannot tell.",
        opt("log", not_empty, "LOG", ".csv .mat .mf4, or a bus log"),
        choices(("vehicle",), defaults={"vehicle": None}),  # required
        *_measured("fit"),
        opt("--check", str, "FROM:TO", "part (s) to predict with the fit"),
        opt("--actuator", ("bars", "suspension"), None, "actuators whose moments the log has "
            "(default: bars; of corner forces, suspension)", ""),
        repeated("--free", str, "KEY", "fit this number though its source says that it is known"),
        repeated("--hold", str, "KEY", "hold this number"),
        opt("--starts", int, "N", "searches from different numbers, up to four times as many where "
            "none is confirmed (default: %(default)s)", 3),
        execution("start", "scheduler", "resume", "only"),
        *answer("vehicle, page and covariance"),
    )  # fmt: skip


def _measured(verb: str) -> tuple[Option, ...]:
    """Return the options of how a measured drive is read, and which part of it."""
    return (
        repeated("--signal", not_empty, "QUANTITY=[-]NAME[:UNIT]", "signal of the log that is a "
                 "quantity: time, steering, speed, yaw_rate, lateral_acceleration, roll_rate, "
                 "roll, sideslip, travel_front_left, delivered_front, commanded_front, "
                 "commanded_force_front_left, …; - reverses it, UNIT may be 16*rad, without NAME "
                 "it is left out"),
        opt("--rate", float, "HZ", "samples per second of a log without a column of times"),
        opt("--dbc", str, "FILE", "network description of a bus log", ""),
        opt("--map", str, "FILE", "map of its signals to the ECU's fields", ""),
        opt("--imu", ("body", "levelled"), None, "axes of the inertial unit: the body's, or "
            "levelled, without gravity (default: body)", "body"),
        opt("--from", float, "S", f"{verb} from this time on", -inf, dest="begin"),
        opt("--to", float, "S", "up to this", inf, dest="end"),
    )  # fmt: skip


def validate(parser: Parser) -> None:
    """A verdict on a vehicle by measured drives."""
    parser.take(
        "Judge a vehicle by measured drives: the 14-DOF car is steered as measured, and every "
        "signal is rated (ISO/TS 18571). Of a steady circle, a step steer, a sine sweep and a sine "
        "with dwell the figures of their standards are compared too. Exit code 1 if anything is "
        "not good enough.",
        opt("logs", not_empty, "LOG", ".csv .mat .mf4, or bus logs", nargs="+"),
        choices(("vehicle",), defaults={"vehicle": None}),  # required
        *_measured("compare"),
        opt("--manoeuvre", str, "NAME", "steady_circle, step_steer, sine_sweep, sine_with_dwell or "
            "free (default: recognised by the steering)", ""),
        opt("--zero", str, "FROM:TO", "part (s) of straight driving, whose means are the offsets "
            "of all signals", excludes={"measurement": "--measurement has the offsets"}),
        opt("--measurement", path_named, "FILE", "fit.json of 'canroll fit', whose offsets and "
            "delays are those of the log"),
        opt("--rating", float, "R", "least rating of a signal by ISO/TS 18571 (default: "
            "%(default)s)", 0.80),
        repeated("--explained", key_value, "SIGNAL=SHARE", "least share of a signal's variance "
                 "that is accounted for (default: yaw_rate 0.995, lateral_acceleration 0.98, "
                 "roll_rate 0.93, others 0.94)"),
        opt("--error", float, "SHARE", "largest RMS of a difference over the largest measured "
            "value (default: no limit)", inf),
        repeated("--tolerance", key_value, "NAME=OFFSET:GAIN", "tolerance of figures of a "
                 "manoeuvre, OFFSET plus GAIN times the value, such as circle.roll=0.2:0.05"),
        *answer("page and numbers"),
    )  # fmt: skip
