"""Fault-free runs: how often a monitor accuses, with the Clopper-Pearson bound on its rate.

``python -m tools.validation.false_alarms --first 100000 --runs 1000``: run k is drawn from its
number alone: vehicle, population, actuator, law, manoeuvre up to the limit, grip 0.35 to 1, bank,
road, bus, speed, noise, bias, temperature, with and without control, on the nonlinear plant. Runs
below 100 000 served to choose the thresholds; those from there on check them.
"""

import argparse
import sys
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import beta

from canroll.errors import CanrollError
from firmware.plausibility import (
    FAULT_ACTUATOR_CONTRADICTED,
    FAULT_LATERAL_CONTRADICTED,
    FAULT_MOTION_CONTRADICTED,
    FAULT_ROLL_RATE_CONTRADICTED,
)
from hil.reaction.fault_codes import in_words
from hil.runs import experiment
from hil.studies.variation import DEFAULT_SPREAD, draw
from tools.progress import progress

VEHICLES = ("van_real", "suv_2020", "van_2021", "van_2022", "car_2020", "sedan_320i")
MANEUVERS = (
    *("double_lane_change", "moose", "roundabout", "constant_radius", "banked_curve"),
    *("bumps", "random_road", "fishhook", "j_turn", "sine_with_dwell"),
)
BUSES = ("500k", "125k_busy", "gateway_20ms", "gateway_50ms")
LAWS = ("lqr", "steering_lead")
MONITORS = (
    1 << FAULT_ROLL_RATE_CONTRADICTED
    | 1 << FAULT_LATERAL_CONTRADICTED
    | 1 << FAULT_MOTION_CONTRADICTED
    | 1 << FAULT_ACTUATOR_CONTRADICTED
)
UNSEEN = 100_000
CONFIDENCE = 0.95


def drawn(number: int) -> tuple[str, dict[str, Any], bool, bool]:
    """Return manoeuvre, choices, whether the actuators are enabled and the vehicle varied."""
    random = np.random.default_rng([14, number])
    maneuver = str(random.choice(MANEUVERS))
    options: dict[str, Any] = {}
    if random.random() < 0.7:
        options["friction"] = round(random.uniform(0.35, 1.0), 2)
    if maneuver == "banked_curve":
        options["bank_deg"] = round(random.uniform(-10.0, 10.0), 1)
    if maneuver == "bumps":
        options["height"] = round(random.uniform(0.01, 0.06), 3)
    if maneuver == "random_road":
        options["road_class"] = str(random.choice(["A", "B", "C"]))
    conditions = {
        "noise": round(random.uniform(0.0, 2.0), 2),
        "bias": round(random.uniform(0.0, 1.5), 2),
        "temperature": round(random.uniform(-30.0, 40.0), 1),
    }
    choices: dict[str, Any] = {
        "vehicle": str(random.choice(VEHICLES)),
        "actuator": str(random.choice(["suspension", "bars"])),
        "law": str(random.choice(LAWS)),
        "bus": str(random.choice(BUSES)),
        "seed": int(random.integers(1 << 16)),
        "options": options,
        "conditions": conditions,
    }
    if random.random() < 0.5:
        choices["speed_kmh"] = round(random.uniform(40.0, 100.0), 1)
    return maneuver, choices, bool(random.random() < 0.8), bool(random.random() < 0.7)


def accused(number: int) -> int:
    """Return the fault codes that the monitors report in run ``number``, as bits."""
    maneuver, choices, enabled, varied = drawn(number)
    settings, controller = experiment.plan(maneuver, **choices)
    if varied:
        vehicle = draw(settings, number, spread=DEFAULT_SPREAD, seed=14)
        settings = replace(vehicle, seed=settings.seed)
    trace = experiment.drive(settings, controller, enabled=enabled)
    return int(np.bitwise_or.reduce(trace.ticks["fault_codes"], initial=0)) & MONITORS


def bound(alarms: int, runs: int) -> float:
    """Return the upper end of the one-sided Clopper-Pearson interval of the rate."""
    return float(beta.ppf(CONFIDENCE, alarms + 1, runs - alarms)) if alarms < runs else 1.0


def main() -> int:
    """Drive the runs and print the result; 1 if a monitor accuses in one of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--first", type=int, default=UNSEEN, help="number of the first run")
    arguments = parser.parse_args()
    driven = alarms = skipped = 0
    with progress("fault-free runs", arguments.runs) as done:
        for number in range(arguments.first, arguments.first + arguments.runs):
            try:
                codes = accused(number)
            except CanrollError:
                # a speed that the manoeuvre cannot be driven at, or a vehicle that cannot be
                skipped += 1
                continue
            finally:
                done(1)
            driven += 1
            if codes:
                alarms += 1
                print(f"run {number}: {', '.join(in_words(codes))}: {drawn(number)}", flush=True)
    print(
        f"{alarms} false alarms in {driven} fault-free runs ({skipped} draws cannot be driven): "
        f"rate below {bound(alarms, driven):.2%} at {CONFIDENCE:.0%} confidence"
    )
    return int(alarms > 0)


if __name__ == "__main__":
    sys.exit(main())
