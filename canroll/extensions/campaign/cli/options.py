"""The options of the commands that drive draws, faults and attacks."""

from canroll.cli.options import (
    DEFAULT_SCENARIO,
    OF_A_RUN,
    ONE_CASE,
    add_answer,
    add_choices,
    add_execution,
    add_numbers,
    add_scenario,
    add_spread,
    path_named,
)
from canroll.cli.parser import Parser

DEFAULT_DRAWS = 100
EVENT_NAMES = (
    *("fails", "rollover", "rollover_passive", "wheel_lift", "wheel_lift_passive"),
    *("limit_cycle", "harm"),
)
"""Events of a draw, see :mod:`canroll.extensions.campaign.events`."""


def campaign(parser: Parser) -> None:
    """Monte Carlo over parameters, noise, delays and faults."""
    parser.description = (
        "Drive a manoeuvre with one calibration on many draws of vehicle, noise, bus and fault: "
        "those of a campaign file, or of the options. The controller is designed for the first "
        "bus; one or none of the given faults is drawn; --seed is that of the draws."
    )
    parser.add_argument(
        "what",
        nargs="?",
        default=DEFAULT_SCENARIO,
        metavar="SCENARIO|FILE.toml",
        help="manoeuvre or campaign file (default: %(default)s)",
    )
    parser.add_argument(
        "--runs", type=int, metavar="N", help=f"draws (default: the file's, or {DEFAULT_DRAWS})"
    )
    add_spread(parser)
    parser.add_argument(
        "--worst-by",
        default="reduction",
        metavar="METRIC",
        help="what the hardest draws go by after failures: reduction of the roll angle, or the "
        "largest value with control of a metric such as roll_max_deg (default: %(default)s)",
    )
    parser.add_argument(
        "--until",
        excludes={"only": ONE_CASE},
        type=float,
        metavar="WIDTH",
        help="stop when the 95 %% interval of the event's probability is at most this wide",
    )
    parser.add_argument(
        "--event",
        needs=("until",),
        choices=EVENT_NAMES,
        default=EVENT_NAMES[0],
        help=f"event of --until: {', '.join(EVENT_NAMES)} (default: %(default)s)",
    )
    add_execution(parser, "draw")
    add_choices(parser, OF_A_RUN, several=("bus",))
    add_answer(parser, "page and table")
    parser.set_defaults(verbose=False)


def faults(parser: Parser) -> None:
    """Drive and judge a catalogue of faults."""
    parser.description = (
        "Drive a manoeuvre with each fault of a catalogue, single and double, and judge what was "
        "detected, when, and with what harm. Exit code 1 if anything harmful goes undetected."
    )
    add_scenario(parser, DEFAULT_SCENARIO)
    parser.add_argument("--all", action="store_true", help="list every fault, not only the worst")
    parser.add_argument(
        "--catalogue", type=path_named, metavar="FILE", help="TOML file (default: the shipped one)"
    )
    add_choices(parser, [name for name in OF_A_RUN if name not in ("faults", "fault_file")])
    add_execution(parser, "fault")
    add_numbers(parser)


def attacks(parser: Parser) -> None:
    """Attackers on the bus, without authentication and with it."""
    parser.handler = "canroll.extensions.campaign.cli.faults:attacks"
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
