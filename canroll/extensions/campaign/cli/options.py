"""The options of the commands that drive draws and faults."""

from canroll.cli.options import (
    DEFAULT_SCENARIO,
    NUMBERS,
    OF_A_RUN,
    ONE_CASE,
    RARE_OF_A_RUN,
    SPREAD,
    answer,
    choices,
    execution,
    path_named,
    scenario_named,
)
from canroll.cli.parser import Parser, flag, opt

DEFAULT_DRAWS = 100
ATTACKS = "attacks"
"""The catalogue of attackers on the bus, in place of a file of faults."""
EVENT_NAMES = (
    *("fails", "rollover", "rollover_passive", "wheel_lift", "wheel_lift_passive"),
    *("limit_cycle", "harm"),
)
"""Events of a draw, see :mod:`canroll.extensions.campaign.events`."""


def campaign(parser: Parser) -> None:
    """Monte Carlo over parameters, noise, delays and faults."""
    parser.take(
        "Drive a manoeuvre with one calibration on many draws of vehicle, noise, bus and fault: "
        "those of a campaign file, or of the options. The controller is designed for the first "
        "bus; one or none of the given faults is drawn; --seed is that of the draws.",
        opt("what", str, "SCENARIO|FILE.toml", "manoeuvre or campaign file (default: %(default)s)",
            DEFAULT_SCENARIO, nargs="?"),
        opt("--runs", int, "N", f"draws (default: the file's, or {DEFAULT_DRAWS})"),
        SPREAD,
        opt("--worst-by", str, "METRIC", "what the hardest draws go by after failures: reduction "
            "of the roll angle, or the largest value with control of a metric such as roll_max_deg "
            "(default: %(default)s)", "reduction"),
        opt("--until", float, "WIDTH", "stop when the 95 %% interval of the event's probability is "
            "at most this wide", excludes={"only": ONE_CASE}),
        opt("--event", EVENT_NAMES, None, f"event of --until: {', '.join(EVENT_NAMES)} (default: "
            "%(default)s)", EVENT_NAMES[0], needs=("until",)),
        execution("draw"),
        choices(OF_A_RUN, several=("bus",)),
        *answer("page and table"),
    )  # fmt: skip
    parser.set_defaults(verbose=False)


def faults(parser: Parser) -> None:
    """Drive and judge a catalogue of faults, or of attackers on the bus."""
    of_attacks = {f"catalogue={ATTACKS}": "--catalogue attacks lists every attack"}
    parser.take(
        "Drive a manoeuvre with each fault of a catalogue, single and double, and judge what was "
        "detected, when, and with what harm. Exit code 1 where unexcused harm goes undetected. "
        "With --catalogue attacks: with an attacker on the bus, who sends spoofed, replayed, "
        "damaged and foreign frames, floods, and resets of nodes; on 500k and on secured_fd, or on "
        "--bus. Exit code 1 if a forged frame is accepted on a bus with authenticated frames.",
        scenario_named(DEFAULT_SCENARIO),
        flag("--all", "list every fault, not only the worst", excludes=of_attacks),
        opt("--catalogue", path_named, "FILE", f"TOML file, or {ATTACKS} (default: the shipped "
            "catalogue of faults)"),
        opt("--attack", str, "TEXT", "only attacks whose name contains TEXT", "",
            needs=(f"catalogue={ATTACKS}",)),
        choices([name for name in OF_A_RUN if name not in ("faults", "fault_file")],
                of_file=RARE_OF_A_RUN),
        execution("fault or attack"),
        *NUMBERS,
    )  # fmt: skip
