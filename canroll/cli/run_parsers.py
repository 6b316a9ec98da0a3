"""The options of the commands that simulate, and that characterise a vehicle."""

from pathlib import Path
from typing import Any

from canroll.cli.options import (
    DEFAULT_SCENARIO,
    JSON,
    OF_A_RUN,
    RARE_OF_A_RUN,
    RECORDING,
    SPREAD,
    answer,
    choices,
    execution,
    not_empty,
    path_named,
    scenario,
    verbose,
)
from canroll.cli.parser import Parser, flag, opt, related
from canroll.plant_sim.driving import MANEUVERS
from canroll.setup.choices import CHOICES

NEW, SAVED = "new run", "saved run"
"""What SCENARIO of ``canroll run`` can be."""
SEVERE = "severe"
"""The catalogue of manoeuvres of :mod:`canroll.studies.severe`, in place of a manoeuvre."""
VEHICLES = 20
OF_RUNS = ("law", "stage", "calibration", "seed", "phase_ms", "duration")
"""Choices of single runs that a comparison of all laws by a population has no use for."""
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
    dict[str, Any](needs=(f"what={test}",), why=f"canroll handling {test}")
    for test in ("circle", "response", "limit")
)
PICTURE = "response.png"


def run(parser: Parser) -> None:
    """Run a manoeuvre in virtual time, with and without control."""
    parser.take(
        "Drive a manoeuvre in virtual time, without and with control, and report. Of the folder of "
        "a saved run, written by 'canroll run' or 'canroll hil': evaluate it again and write its "
        "page, by default in that folder.",
        opt("scenario", _manoeuvre_or_folder, None, f"{', '.join(MANEUVERS)}; or the FOLDER of a "
            "saved run"),
        choices(CHOICES),
        *RECORDING,
        flag("--no-trace", "without trace.npz, some 40 MB a minute: the run cannot be read again",
             dest="trace", action="store_false"),
        related("vehicle_set", *CHOICES, "log", "signals", "trace", only=(NEW,)),
        *answer("report, log, header"),
        verbose("response times, trigger and phase"),
    )  # fmt: skip


def _manoeuvre_or_folder(text: str) -> str | Path:
    return Path(text) if text not in MANEUVERS and Path(text).is_dir() else scenario(text)


def compare(parser: Parser) -> None:
    """Compare runs, laws or speeds on one page, or laws by a population of vehicles."""
    parser.take(
        "Drive the same manoeuvre with several controllers, at one or several speeds, and compare "
        "them; saved runs are read from their folders, options apply to the new runs. With --runs "
        "drive every law with a population of vehicles, at equal effort. With --scenario severe "
        "drive lane changes, fishhook, J-turn, sine with dwell and one-sided bumps with a "
        "population of vehicles: without control, with the best passive bar, with the plain "
        "feedforward, and with a law.",
        opt("what", str, "RUN", "a law, a calibration file, choices as "
            "law=lqr,bus=gateway_20ms,name=slow, or the folder of a saved run; of several speeds "
            "by default the options", nargs="*"),
        opt("--scenario", _scenarios, None, f"manoeuvre, or {SEVERE} (default: %(default)s)",
            DEFAULT_SCENARIO),
        opt("--speed", not_empty, "KMH|FROM:TO:STEP", "entry speed, or speeds of each run; by "
            "default that of the vehicle for the manoeuvre", dest="speeds"),
        opt("--runs", int, "N", "vehicles of a population, the same for every law (default of "
            f"{SEVERE}: {VEHICLES})"),
        opt("--effort", float, "NM", "with --runs: common RMS moment (default: half of what holds "
            "the body upright)", needs=("runs",)),
        SPREAD,
        choices([name for name in CHOICES if name != "speed_kmh"], of_file=RARE_OF_A_RUN),
        execution("run, law, or pair of severe manoeuvre and vehicle"),
        related("spread", "resume", needs=("runs", f"scenario={SEVERE}"), why="--runs"),
        *answer("the page, of a population with --out alone for the numbers"),
    )  # fmt: skip


def _scenarios(text: str) -> str:
    return text if text == SEVERE else scenario(text)


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
                defaults={"law": None}, of_file=RARE_OF_A_RUN),
        related(*OF_THE_CONTROLLED, needs=(*CONTROL, "what=limit"), why="--law or --calibration"),
        related(*OF_A_LIMIT, **LIMIT),
        related(*CONTROL, excludes={"linear": "--linear drives nothing"}),
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
