"""The options of the commands that simulate, and that characterise a vehicle."""

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
    add_spread,
    add_verbose,
    path_named,
    scenario,
)
from canroll.cli.parser import Parser, Relations
from canroll.setup.choices import CHOICES, OF_ONE_MANOEUVRE

DEFAULT_SPEEDS = "60:120:20"
LOADS = ("laden", "empty")
CONTROL = ("law", "calibration")
"""Choices of which one adds the controlled vehicle to a handling test."""
WITHOUT_EFFECT = ("vehicle", "plant", "speed_kmh", "options", "faults", "fault_file")
"""Choices of a run that a handling test makes itself, has already, or does without."""


def run(parser: Parser) -> None:
    """Run a manoeuvre in virtual time, with and without control."""
    parser.description = "Drive a manoeuvre in virtual time, without and with control, and report."
    add_scenario(parser)
    add_choices(parser, CHOICES)
    add_recording(parser)
    parser.add_argument(
        "--no-trace",
        dest="trace",
        action="store_false",
        help="without trace.npz, some 40 MB a minute: the run cannot be read again",
    )
    add_answer(parser, "report, log, header")
    add_verbose(parser, "response times, trigger and phase")


def compare(parser: Parser) -> None:
    """Compare several runs or laws on one page."""
    parser.description = (
        "Drive the same manoeuvre with several controllers and compare them; saved runs are read "
        "from their folders. Options apply to the new runs."
    )
    parser.add_argument(
        "runs",
        nargs="+",
        metavar="RUN",
        help="a law, a calibration file, choices as law=lqr,bus=gateway_20ms,name=slow, or the "
        "folder of a saved run",
    )
    parser.add_argument(
        "--scenario",
        type=scenario,
        default=DEFAULT_SCENARIO,
        help="manoeuvre (default: %(default)s)",
    )
    add_choices(parser, CHOICES)
    add_execution(parser, "run", "resume")
    add_answer(parser, "the page")


def sweep(parser: Parser) -> None:
    """Run over a range of speeds or over several laws."""
    parser.handler = "canroll.cli.compare:sweep"
    parser.description = (
        "Drive a manoeuvre at several speeds with one or several laws, calibrations or settings."
    )
    parser.add_argument(
        "what",
        nargs="*",
        metavar="SCENARIO|RUN",
        help=f"manoeuvre (default: {DEFAULT_SCENARIO}), and what to drive, as of compare: a law, "
        "a calibration file, or choices as law=lqr,bus=gateway_20ms (default: options)",
    )
    parser.add_argument(
        "--speed",
        dest="speeds",
        metavar="FROM:TO:STEP",
        default=DEFAULT_SPEEDS,
        help="default: %(default)s",
    )
    names = [name for name in OF_A_RUN if name != "speed_kmh"]
    add_choices(parser, names, several=("law",))
    add_execution(parser, "run", "resume")
    add_answer(parser, "the page")


def report(parser: Parser) -> None:
    """Evaluate a saved run again and write its page."""
    parser.handler = "canroll.cli.run:report"
    parser.description = (
        "Read a run from the folder written by 'canroll run' or 'canroll hil', evaluate it again "
        "and write its page. Several runs on one page: 'canroll compare FOLDER FOLDER'."
    )
    parser.add_argument("folder", type=path_named, metavar="FOLDER", help="folder of a saved run")
    parser.add_argument(
        "--out",
        type=path_named,
        metavar="FILE",
        help="the page (default: report.html in the folder)",
    )
    add_json(parser)
    add_verbose(parser, "response times, trigger and phase")


def limit(parser: Parser) -> None:
    """Highest speed at which a manoeuvre passes."""
    parser.handler = "canroll.cli.vehicle_tests:limit"
    parser.description = (
        "Bisect the entry speed for the highest at which the manoeuvre's criteria are met, without "
        "and with control: no two wheels of a side two inches off the road, no cone hit, the yaw "
        "rate decayed, as required by its standard."
    )
    add_scenario(parser)
    names = [name for name in OF_A_RUN if name != "speed_kmh"]
    add_choices(parser, names)
    parser.add_argument("--from", dest="low", type=float, default=30.0, metavar="KMH")
    parser.add_argument("--to", dest="high", type=float, metavar="KMH", help="default: fastest")
    parser.add_argument(
        "--tolerance", type=float, default=0.5, metavar="KMH", help="final bracket (default: 0.5)"
    )
    add_json(parser)


def _add_control(parser: Parser) -> None:
    """Add the choices of the controlled vehicle, which is driven if a law or calibration is."""
    others = [name for name in OF_A_RUN if name not in {*CONTROL, *WITHOUT_EFFECT}]
    add_choices(parser, (*CONTROL, *others), defaults={"law": None})
    parser.relate(Relations(needs=CONTROL, why="--law or --calibration"), *others)
    parser.asked = CONTROL


def understeer(parser: Parser) -> None:
    """Understeer and roll gradient on a circle (ISO 4138)."""
    parser.handler = "canroll.cli.vehicle_tests:understeer"
    parser.description = (
        "Drive a circle at increasing speed; steering, roll and sideslip of each steady turn, and "
        "the gradients of their linear part. With --law or --calibration without and with control."
    )
    add_choices(parser, ("vehicle", "plant"))
    _add_control(parser)
    parser.add_argument("--radius", type=float, default=100.0, metavar="M", help="default: 100")
    add_json(parser)


def response(parser: Parser) -> None:
    """Yaw and roll frequency response to steering (ISO 7401)."""
    parser.handler = "canroll.cli.vehicle_tests:response"
    parser.description = (
        "Steer in sines of rising frequency; yaw rate, lateral acceleration and roll angle per "
        "steering-wheel angle. With --law or --calibration without and with control. With "
        "--linear: the plant linearised about straight running or a steady curve, its modes, its "
        "responses to moment and steering, and its distance to the design model."
    )
    add_choices(parser, ("vehicle", "plant"))
    _add_control(parser)
    parser.relate(Relations(excludes={"linear": "--linear drives nothing"}), *CONTROL)
    parser.add_argument("--speed", type=float, default=100.0, metavar="KMH", help="default: 100")
    parser.add_argument(
        "--load", choices=LOADS, default=LOADS[0], help="laden or empty (default: %(default)s)"
    )
    parser.add_argument("--linear", action="store_true", help="linearise instead of steering")
    linear = ("linear",)
    parser.add_argument(
        "--lateral-acceleration",
        needs=linear,
        type=float,
        metavar="M/S2",
        help="with --linear: that of the steady curve (default: 0, straight ahead)",
    )
    parser.add_argument(
        "--friction",
        needs=linear,
        type=float,
        metavar="MU",
        help="with --linear: that of the road (default: 1)",
    )
    parser.add_argument(
        "--out",
        needs=(*linear, *CONTROL),
        why="--linear, --law or --calibration",
        type=path_named,
        metavar="DIR",
        help="with --linear, --law or --calibration: write response.png there",
    )
    add_json(parser)


def severe(parser: Parser) -> None:
    """Severe manoeuvres over a population of vehicles."""
    parser.handler = "canroll.cli.vehicle_tests:severe"
    parser.description = (
        "Drive lane changes, fishhook, J-turn, sine with dwell and one-sided bumps with a "
        "population of vehicles: without control, with the best passive bar, with the plain "
        "feedforward, and with a law."
    )
    names = [name for name in OF_A_RUN if name not in OF_ONE_MANOEUVRE]
    add_choices(parser, names)
    parser.add_argument(
        "--runs", type=int, default=20, metavar="N", help="vehicles (default: %(default)s)"
    )
    add_spread(parser)
    add_execution(parser, "pair of manoeuvre and vehicle")
    add_numbers(parser)
