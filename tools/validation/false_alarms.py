"""Fault-free runs: how often a monitor accuses, with the Clopper-Pearson bound on its rate.

``python -m tools.validation.false_alarms --runs 500``: run k is drawn from its number alone:
vehicle, actuator, manoeuvre up to the limit, grip 0.35 to 1, bank, road, bus, speed, noise, bias,
temperature, with and without control, on the nonlinear plant. Even numbers served to choose the
thresholds, odd ones check them.
"""

import argparse
import sys
from typing import Any

import numpy as np
from scipy.stats import beta

from canroll.errors import CanrollError
from firmware.plausibility import (
    FAULT_ACTUATOR_CONTRADICTED,
    FAULT_LATERAL_CONTRADICTED,
    FAULT_ROLL_RATE_CONTRADICTED,
    FAULT_STROKE_CONTRADICTED,
)
from hil.runs import experiment
from tools.progress import progress

VEHICLES = ("van_real", "suv_2020", "van_2021", "van_2022", "car_2020", "sedan_320i")
MANEUVERS = (
    *("double_lane_change", "moose", "roundabout", "constant_radius", "banked_curve"),
    *("bumps", "random_road", "fishhook", "j_turn", "sine_with_dwell"),
)
BUSES = ("500k", "125k_busy", "gateway_20ms")
MONITORS = (
    1 << FAULT_ROLL_RATE_CONTRADICTED
    | 1 << FAULT_LATERAL_CONTRADICTED
    | 1 << FAULT_STROKE_CONTRADICTED
    | 1 << FAULT_ACTUATOR_CONTRADICTED
)
CONFIDENCE = 0.95


def drawn(number: int) -> tuple[str, dict[str, Any], bool]:
    """Return manoeuvre, choices and whether the actuators are enabled in run ``number``."""
    draw = np.random.default_rng([14, number])
    maneuver = str(draw.choice(MANEUVERS))
    options: dict[str, Any] = {}
    if draw.random() < 0.7:
        options["friction"] = round(draw.uniform(0.35, 1.0), 2)
    if maneuver == "banked_curve":
        options["bank_deg"] = round(draw.uniform(-10.0, 10.0), 1)
    if maneuver == "bumps":
        options["height"] = round(draw.uniform(0.01, 0.06), 3)
    if maneuver == "random_road":
        options["road_class"] = str(draw.choice(["A", "B", "C"]))
    conditions = {
        "noise": round(draw.uniform(0.0, 2.0), 2),
        "bias": round(draw.uniform(0.0, 1.5), 2),
        "temperature": round(draw.uniform(-30.0, 40.0), 1),
    }
    choices: dict[str, Any] = {
        "vehicle": str(draw.choice(VEHICLES)),
        "actuator": str(draw.choice(["suspension", "bars"])),
        "law": "lqr",
        "bus": str(draw.choice(BUSES)),
        "seed": int(draw.integers(1 << 16)),
        "options": options,
        "conditions": conditions,
    }
    if draw.random() < 0.5:
        choices["speed_kmh"] = round(draw.uniform(40.0, 100.0), 1)
    return maneuver, choices, bool(draw.random() < 0.7)


def accused(number: int) -> int:
    """Return the fault codes that the monitors report in run ``number``, as bits."""
    maneuver, choices, enabled = drawn(number)
    settings, controller = experiment.plan(maneuver, **choices)
    trace = experiment.drive(settings, controller, enabled=enabled)
    return int(np.bitwise_or.reduce(trace.ticks["fault_codes"], initial=0)) & MONITORS


def bound(alarms: int, runs: int) -> float:
    """Return the upper end of the one-sided Clopper-Pearson interval of the rate."""
    return float(beta.ppf(CONFIDENCE, alarms + 1, runs - alarms)) if alarms < runs else 1.0


def main() -> int:
    """Drive the runs and print the result; 1 if a monitor accuses in a run that checks."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    arguments = parser.parse_args()
    count, alarms = [0, 0], [0, 0]
    with progress("fault-free runs", arguments.runs) as done:
        for number in range(arguments.first, arguments.first + arguments.runs):
            try:
                codes = accused(number)
            except CanrollError as error:
                # a speed that the manoeuvre cannot be driven at
                print(f"run {number} not driven: {error}")
                continue
            finally:
                done(1)
            count[number % 2] += 1
            if codes:
                alarms[number % 2] += 1
                maneuver, choices, enabled = drawn(number)
                print(f"run {number}: {codes:#x} {maneuver} {choices} enabled={enabled}")
    for half, name in enumerate(("chose thresholds", "checks them")):
        if count[half]:
            rate = bound(alarms[half], count[half])
            print(
                f"{name:16}  {alarms[half]} false alarms in {count[half]} runs, "
                f"rate below {rate:.2%} at {CONFIDENCE:.0%} confidence"
            )
    return int(alarms[1] > 0)


if __name__ == "__main__":
    sys.exit(main())
