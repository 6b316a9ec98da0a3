"""The options of the commands that simulate, and that characterise a vehicle."""

from canroll.cli.options import (
    DEFAULT_SCENARIO,
    JSON,
    NUMBERS,
    OF_A_RUN,
    RECORDING,
    SPREAD,
    answer,
    choices,
    execution,
    path_named,
    scenario,
    scenario_named,
    verbose,
)
from canroll.cli.parser import Parser, Relations, flag, opt, related
from canroll.setup.choices import CHOICES, OF_ONE_MANOEUVRE

DEFAULT_SPEEDS = "60:120:20"
LOADS = ("laden", "empty")
CONTROL = ("law", "calibration")
"""Choices of which one adds the controlled vehicle to a handling test."""
WITHOUT_EFFECT = ("vehicle", "plant", "speed_kmh", "options", "faults", "fault_file")
"""Choices of a run that a handling test makes itself, has already, or does without."""
AT_ANY_SPEED = [name for name in OF_A_RUN if name != "speed_kmh"]
OF_THE_CONTROLLED = [name for name in OF_A_RUN if name not in {*CONTROL, *WITHOUT_EFFECT}]
CONTROLLED = (
    choices((*CONTROL, *OF_THE_CONTROLLED), defaults={"law": None}),
    related(Relations(needs=CONTROL, why="--law or --calibration"), *OF_THE_CONTROLLED),
)
"""Options of the controlled vehicle, which is driven if a law or calibration is given."""
LINEAR = ("linear",)


def run(parser: Parser) -> None:
    """Run a manoeuvre in virtual time, with and without control."""
    parser.take(
        "Drive a manoeuvre in virtual time, without and with control, and report.",
        scenario_named(),
        choices(CHOICES),
        *RECORDING,
        flag("--no-trace", "without trace.npz, some 40 MB a minute: the run cannot be read again",
             dest="trace", action="store_false"),
        *answer("report, log, header"),
        verbose("response times, trigger and phase"),
    )  # fmt: skip


def compare(parser: Parser) -> None:
    """Compare several runs or laws on one page."""
    parser.take(
        "Drive the same manoeuvre with several controllers and compare them; saved runs are read "
        "from their folders. Options apply to the new runs.",
        opt("runs", str, "RUN", "a law, a calibration file, choices as "
            "law=lqr,bus=gateway_20ms,name=slow, or the folder of a saved run", nargs="+"),
        opt("--scenario", scenario, None, "manoeuvre (default: %(default)s)", DEFAULT_SCENARIO),
        choices(CHOICES),
        execution("run", "resume"),
        *answer("the page"),
    )  # fmt: skip


def sweep(parser: Parser) -> None:
    """Run over a range of speeds or over several laws."""
    parser.handler = "canroll.cli.compare:sweep"
    parser.take(
        "Drive a manoeuvre at several speeds with one or several laws, calibrations or settings.",
        opt("what", str, "SCENARIO|RUN", f"manoeuvre (default: {DEFAULT_SCENARIO}), and what to "
            "drive, as of compare: a law, a calibration file, or choices as "
            "law=lqr,bus=gateway_20ms (default: options)", nargs="*"),
        opt("--speed", str, "FROM:TO:STEP", "default: %(default)s", DEFAULT_SPEEDS, dest="speeds"),
        choices(AT_ANY_SPEED, several=("law",)),
        execution("run", "resume"),
        *answer("the page"),
    )  # fmt: skip


def report(parser: Parser) -> None:
    """Evaluate a saved run again and write its page."""
    parser.handler = "canroll.cli.run:report"
    parser.take(
        "Read a run from the folder written by 'canroll run' or 'canroll hil', evaluate it again "
        "and write its page. Several runs on one page: 'canroll compare FOLDER FOLDER'.",
        opt("folder", path_named, "FOLDER", "folder of a saved run"),
        opt("--out", path_named, "FILE", "the page (default: report.html in the folder)"),
        JSON,
        verbose("response times, trigger and phase"),
    )


def limit(parser: Parser) -> None:
    """Highest speed at which a manoeuvre passes."""
    parser.handler = "canroll.cli.vehicle_tests:limit"
    parser.take(
        "Bisect the entry speed for the highest at which the manoeuvre's criteria are met, without "
        "and with control: no two wheels of a side two inches off the road, no cone hit, the yaw "
        "rate decayed, as required by its standard.",
        scenario_named(),
        choices(AT_ANY_SPEED),
        opt("--from", float, "KMH", None, 30.0, dest="low"),
        opt("--to", float, "KMH", "default: fastest", dest="high"),
        opt("--tolerance", float, "KMH", "final bracket (default: 0.5)", 0.5),
        JSON,
    )


def understeer(parser: Parser) -> None:
    """Understeer and roll gradient on a circle (ISO 4138)."""
    parser.handler = "canroll.cli.vehicle_tests:understeer"
    parser.asked = CONTROL
    parser.take(
        "Drive a circle at increasing speed; steering, roll and sideslip of each steady turn, and "
        "the gradients of their linear part. With --law or --calibration without and with control.",
        choices(("vehicle", "plant")),
        *CONTROLLED,
        opt("--radius", float, "M", "default: 100", 100.0),
        JSON,
    )


def response(parser: Parser) -> None:
    """Yaw and roll frequency response to steering (ISO 7401)."""
    parser.handler = "canroll.cli.vehicle_tests:response"
    parser.asked = CONTROL
    parser.take(
        "Steer in sines of rising frequency; yaw rate, lateral acceleration and roll angle per "
        "steering-wheel angle. With --law or --calibration without and with control. With "
        "--linear: the plant linearised about straight running or a steady curve, its modes, its "
        "responses to moment and steering, and its distance to the design model.",
        choices(("vehicle", "plant")),
        *CONTROLLED,
        related(Relations(excludes={"linear": "--linear drives nothing"}), *CONTROL),
        opt("--speed", float, "KMH", "default: 100", 100.0),
        opt("--load", LOADS, None, "laden or empty (default: %(default)s)", LOADS[0]),
        flag("--linear", "linearise instead of steering"),
        opt("--lateral-acceleration", float, "M/S2", "with --linear: that of the steady curve "
            "(default: 0, straight ahead)", needs=LINEAR),
        opt("--friction", float, "MU", "with --linear: that of the road (default: 1)",
            needs=LINEAR),
        opt("--out", path_named, "DIR", "with --linear, --law or --calibration: write response.png "
            "there", needs=(*LINEAR, *CONTROL), why="--linear, --law or --calibration"),
        JSON,
    )  # fmt: skip


def severe(parser: Parser) -> None:
    """Severe manoeuvres over a population of vehicles."""
    parser.handler = "canroll.cli.vehicle_tests:severe"
    parser.take(
        "Drive lane changes, fishhook, J-turn, sine with dwell and one-sided bumps with a "
        "population of vehicles: without control, with the best passive bar, with the plain "
        "feedforward, and with a law.",
        choices([name for name in OF_A_RUN if name not in OF_ONE_MANOEUVRE]),
        opt("--runs", int, "N", "vehicles (default: %(default)s)", 20),
        SPREAD,
        execution("pair of manoeuvre and vehicle"),
        *NUMBERS,
    )
