"""``canroll limit``: the highest speed at which a manoeuvre is still passed, by bisection."""

import argparse
import json
from dataclasses import replace
from typing import Any

from canroll.errors import CanrollError
from hil.cli.options import choices_of
from hil.runs import experiment
from hil.runs.choices import PASSIVE
from hil.runs.frozen import Controller
from hil.runs.result import Settings
from plant_sim.driving import maneuvers, standards
from plant_sim.world import handling
from plant_sim.world.handling import SpeedLimit

JUDGED = ("double_lane_change", "fishhook", "j_turn", "moose", "sine_with_dwell")
"""Manoeuvres that have criteria to pass or fail by."""


def find(
    settings: Settings,
    controller: Controller,
    *,
    enabled: bool,
    low: float,
    high: float,
    tolerance: float,
) -> SpeedLimit:
    """Bisect the entry speed between ``low`` and ``high``; speeds and ``tolerance`` in m/s."""

    def fails(speed: float) -> bool:
        trace = experiment.drive(replace(settings, speed=speed), controller, enabled=enabled)
        if trace.signals["rollover"].max() > 0:
            return True
        verdicts = standards.judge(settings.scenario, settings.vehicle, trace.signals)
        return not all(verdict.passed for verdict in verdicts)

    return handling.bisect_speed(fails, low=low, high=high, tolerance=tolerance)


def run(args: argparse.Namespace) -> int:
    """Bisect without and with control and print both limits; 0 whatever they are."""
    slowest, fastest = (speed * 3.6 for speed in maneuvers.speed_range(args.scenario))
    if args.scenario not in JUDGED:
        raise CanrollError(
            f"{args.scenario} has no criterion to pass or fail by: choose {', '.join(JUDGED)}"
        )
    high = fastest if args.high is None else args.high
    if not slowest <= args.low < high <= fastest + 1e-6:
        raise CanrollError(
            f"speeds {args.low:g} to {high:g} km/h: {args.scenario} is driven at {slowest:g} to "
            f"{fastest:g} km/h, and --from must lie below --to"
        )
    if not 0.01 <= args.tolerance <= high - args.low:
        raise CanrollError(f"tolerance {args.tolerance:g} km/h: must lie in 0.01 to the range")
    settings, controller = experiment.plan(args.scenario, **choices_of(args))
    bracket = {
        "low": args.low / 3.6,
        "high": high / 3.6,
        "tolerance": args.tolerance / 3.6,
    }
    limits = {"passive": find(settings, controller, enabled=False, **bracket), "controlled": None}
    if settings.law != PASSIVE:
        limits["controlled"] = find(settings, controller, enabled=True, **bracket)
    answer: dict[str, Any] = {
        "scenario": settings.scenario,
        "vehicle": settings.vehicle.name,
        "law": settings.law,
        "plant": settings.plant,
        "from_kmh": args.low,
        "to_kmh": round(high, 6),
    }
    for name, limit in limits.items():
        answer[name] = None if limit is None else _kmh(limit)
    if args.json:
        print(json.dumps(answer))
        return 0
    print(f"{maneuvers.title(settings.scenario)}, {settings.vehicle.name}, {settings.plant} plant")
    for name, limit in limits.items():
        if limit is not None:
            print(f"  {name:11}{_words(limit)}")
    return 0


def _kmh(limit: SpeedLimit) -> dict[str, float | None]:
    speeds = {"passed_kmh": limit.passed, "failed_kmh": limit.failed}
    return {
        name: None if speed is None else round(speed * 3.6, 3) for name, speed in speeds.items()
    }


def _words(limit: SpeedLimit) -> str:
    if limit.passed is None:
        return f"fails already at {(limit.failed or 0.0) * 3.6:.1f} km/h"
    if limit.failed is None:
        return f"passes up to {limit.passed * 3.6:.1f} km/h, the fastest tried"
    return f"passes up to {limit.passed * 3.6:.1f} km/h, fails at {limit.failed * 3.6:.1f}"
