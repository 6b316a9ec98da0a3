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
OF_A_LIMIT = ("options", "faults", "fault_file")
"""Choices of a run that circle and response make themselves, or do without."""
AT_ANY_SPEED = [name for name in OF_A_RUN if name != "speed_kmh"]
OF_THE_CONTROLLED = [
    name for name in AT_ANY_SPEED if name not in ("vehicle", "plant", *CONTROL, *OF_A_LIMIT)
]
CIRCLE, RESPONSE, LIMIT = (
    {"needs": (f"what={test}",), "why": f"canroll handling {test}"}
    for test in ("circle", "response", "limit")
)
PICTURE = "response.png"


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


def handling(parser: Parser) -> None:
    """Understeer, frequency response and limit of a vehicle, without and with control."""
    parser.asked = (*CONTROL, "what=limit")
    parser.take(
        "circle: drive a circle at increasing speed (ISO 4138): steering, roll and sideslip of "
        "each steady turn, and the gradients of their linear part. "
        "response: steer in sines of rising frequency (ISO 7401): yaw rate, lateral acceleration "
        "and roll angle per steering-wheel angle; with --linear the plant linearised about "
        "straight running or a steady curve: its modes, its responses to moment and steering, and "
        "its distance to the design model. "
        "limit: bisect the entry speed for the highest at which the criteria of a manoeuvre's "
        "standard are met: no two wheels of a side two inches off the road, no cone hit, the yaw "
        "rate decayed. Circle and response drive with control where --law or --calibration is "
        "given, limit always.",
        opt("what", ("circle", "response", "limit"), "TEST", "circle, response or limit"),
        opt("scenario", scenario, None, "of limit: the manoeuvre", nargs="?"),
        choices(("vehicle", "plant", *CONTROL, *OF_THE_CONTROLLED, *OF_A_LIMIT),
                defaults={"law": None}),
        related(Relations(needs=(*CONTROL, "what=limit"), why="--law or --calibration"),
                *OF_THE_CONTROLLED),
        related(Relations(**LIMIT), *OF_A_LIMIT),
        related(Relations(excludes={"linear": "--linear drives nothing"}), *CONTROL),
        opt("--radius", float, "M", "of the circle (default: 100)", 100.0, **CIRCLE),
        opt("--speed", float, "KMH", "default: 100", 100.0, **RESPONSE),
        opt("--load", LOADS, None, "laden or empty (default: %(default)s)", LOADS[0], **RESPONSE),
        flag("--linear", "linearise instead of steering", **RESPONSE),
        opt("--lateral-acceleration", float, "M/S2", "with --linear: that of the steady curve "
            "(default: 0, straight ahead)", needs=("linear",)),
        opt("--friction", float, "MU", "with --linear: that of the road (default: 1)",
            needs=("linear",)),
        opt("--out", path_named, "DIR", f"write {PICTURE} there", **RESPONSE),
        opt("--from", float, "KMH", "lowest speed (default: 30)", 30.0, dest="low", **LIMIT),
        opt("--to", float, "KMH", "highest speed (default: fastest)", dest="high", **LIMIT),
        opt("--tolerance", float, "KMH", "final bracket (default: 0.5)", 0.5, **LIMIT),
        JSON,
    )  # fmt: skip


def severe(parser: Parser) -> None:
    """Severe manoeuvres over a population of vehicles."""
    parser.handler = "canroll.cli.compare:severe"
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
