"""Fault-free runs: how often a monitor accuses, with the Clopper-Pearson bound on its rate.

``python -m tools.validation.false_alarms --first 100000 --runs 1000``: run k is drawn from its
number alone: vehicle, population, actuator, law, manoeuvre up to the limit, grip 0.35 to 1, bank,
road, bus, speed, noise, bias, temperature, with and without control, on the nonlinear plant. Runs
below 100 000 served to choose the thresholds; those from there on check them. Runs of one design
are driven together, by ``--jobs`` processes; what is found does not depend on how many. A run in
which the vehicle rolls over is past the limit: it counts apart.
"""

import argparse
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import lru_cache
from multiprocessing import get_context
from typing import Any

import numpy as np
from scipy.stats import beta

from canroll.errors import CanrollError
from canroll.reaction.fault_codes import in_words
from canroll.runs import experiment
from canroll.runs.result import Settings
from canroll.setup.controller import PreparedController
from canroll.studies.variation import DEFAULT_SPREAD, draw
from firmware.plausibility import (
    FAULT_ACTUATOR_CONTRADICTED,
    FAULT_COMMAND_LATE,
    FAULT_LATERAL_CONTRADICTED,
    FAULT_MOTION_CONTRADICTED,
    FAULT_ROLL_RATE_CONTRADICTED,
    FAULT_SAMPLE_RATE_OFF,
    FAULT_SENSOR_ERRATIC,
)
from plant_sim.driving import maneuvers
from plant_sim.world.recording import Kept
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
    | 1 << FAULT_COMMAND_LATE
    | 1 << FAULT_SAMPLE_RATE_OFF
    | 1 << FAULT_SENSOR_ERRATIC
)
DESIGN = ("vehicle", "actuator", "law", "bus")
"""The choices that a design depends on."""
UNSEEN = 100_000
TOGETHER = 50
"""Runs of one design that a process is given at once."""
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


@lru_cache(maxsize=1)
def designed(design: tuple[str, ...]) -> tuple[Settings, PreparedController]:
    """Return settings and controller of a design, values of ``DESIGN``."""
    return experiment.plan(MANEUVERS[0], **dict(zip(DESIGN, design, strict=True)))  # type: ignore[misc]


def reported(number: int) -> tuple[int, bool] | None:
    """Return the fault codes of run ``number`` as bits, and whether the vehicle rolls over.

    None if it cannot be driven: at such a speed, or with such a vehicle.
    """
    maneuver, choices, enabled, varied = drawn(number)
    settings, controller = designed(tuple(choices[name] for name in DESIGN))
    speed_kmh = choices.get("speed_kmh")
    settings = replace(
        settings,
        scenario=maneuver,
        seed=choices["seed"],
        speed=maneuvers.default_speed(maneuver, settings.vehicle)
        if speed_kmh is None
        else speed_kmh / 3.6,
        options=tuple(sorted(choices["options"].items())),
        conditions=tuple(sorted(choices["conditions"].items())),
    )
    try:
        if varied:
            vehicle = draw(settings, number, spread=DEFAULT_SPREAD, seed=14)
            settings = replace(vehicle, seed=settings.seed)
        trace = experiment.drive(
            settings,
            controller,
            enabled=enabled,
            kept=Kept(signals=("time", "rollover"), frames=False),
        )
    except CanrollError:
        return None
    over = bool(np.any(np.asarray(trace.signals["rollover"]) > 0))
    return int(np.bitwise_or.reduce(trace.ticks["fault_codes"], initial=0)), over


def all_reported(numbers: tuple[int, ...]) -> list[tuple[int, tuple[int, bool] | None]]:
    """Return numbers of some runs and what was reported."""
    return [(number, reported(number)) for number in numbers]


def by_design(numbers: Iterable[int]) -> list[tuple[int, ...]]:
    """Return the runs in groups of one design each."""
    of = defaultdict(list)
    for number in numbers:
        _, choices, _, _ = drawn(number)
        of[tuple(choices[name] for name in DESIGN)].append(number)
    return [
        tuple(runs[first : first + TOGETHER])
        for _, runs in sorted(of.items())
        for first in range(0, len(runs), TOGETHER)
    ]


def bound(alarms: int, runs: int) -> float:
    """Return the upper end of the one-sided Clopper-Pearson interval of the rate."""
    return float(beta.ppf(CONFIDENCE, alarms + 1, runs - alarms)) if alarms < runs else 1.0


def main() -> int:
    """Drive the runs and print the result; 1 if a monitor accuses in one of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--first", type=int, default=UNSEEN, help="number of the first run")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    arguments = parser.parse_args()
    codes: dict[int, tuple[int, bool] | None] = {}
    groups = by_design(range(arguments.first, arguments.first + arguments.runs))
    with (
        progress("fault-free runs", arguments.runs) as done,
        ProcessPoolExecutor(arguments.jobs, mp_context=get_context("forkserver")) as pool,
    ):
        for task in as_completed([pool.submit(all_reported, group) for group in groups]):
            codes |= task.result()
            done(len(task.result()))
    driven = {number: it for number, it in sorted(codes.items()) if it is not None}
    for number, (bits, over) in driven.items():
        if bits:
            past = ", rolls over" if over else ""
            print(f"run {number}{past}: {', '.join(in_words(bits))}: {drawn(number)}")
    found = {number: bits for number, (bits, over) in driven.items() if not over}
    rolled = [bits for bits, over in driven.values() if over]
    alarms = sum(bool(bits & MONITORS) for bits in found.values())
    print(
        f"{alarms} false alarms in {len(found)} fault-free runs "
        f"({len(codes) - len(driven)} draws cannot be driven): "
        f"rate below {bound(alarms, len(found)):.3%} at {CONFIDENCE:.0%} confidence"
    )
    if rolled:
        accused = sum(bool(bits & MONITORS) for bits in rolled)
        print(f"{len(rolled)} vehicles roll over, {accused} of them with an alarm")
    for word, count in Counter(w for bits in found.values() for w in in_words(bits)).items():
        print(f"{word}: in {count}, rate below {bound(count, len(found)):.3%}")
    return int(alarms > 0)


if __name__ == "__main__":
    sys.exit(main())
