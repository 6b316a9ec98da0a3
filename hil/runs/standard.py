"""Verdict of a run by the manoeuvre's standard: passed, failed, or none."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

import numpy as np

from hil.runs.trace import Trace
from plant_sim.driving import standards
from plant_sim.driving.maneuvers import Maneuver
from plant_sim.driving.standards import Verdict
from plant_sim.world.spool import pieces
from vehicles import Vehicle


@dataclass(frozen=True, slots=True)
class Judged:
    """Verdicts on one run; none if the standard has no criteria or the run was cut short."""

    criteria: tuple[Verdict, ...]

    @property
    def passed(self) -> bool | None:
        """Whether every criterion is met; None without criteria."""
        return all(verdict.passed for verdict in self.criteria) if self.criteria else None

    def to_json(self) -> dict[str, Any]:
        """Return plain data; None for values that are not finite, as the lift after a rollover."""
        return {
            "passed": self.passed,
            "criteria": [
                {
                    name: None if isinstance(value, float) and not isfinite(value) else value
                    for name, value in asdict(verdict).items()
                }
                for verdict in self.criteria
            ],
        }


@dataclass(frozen=True, slots=True)
class Standard:
    """The standard of a manoeuvre, deviations from it, and its verdicts on both runs."""

    name: str
    passive: Judged
    controlled: Judged | None

    def runs(self) -> list[tuple[str, Judged]]:
        """Return the judged runs by their key in the JSON object."""
        runs = [("passive", self.passive), ("controlled", self.controlled)]
        return [(name, judged) for name, judged in runs if judged is not None and judged.criteria]

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "name": self.name,
            "passive": self.passive.to_json(),
            "controlled": None if self.controlled is None else self.controlled.to_json(),
        }


def assess(
    maneuver: Maneuver, vehicle: Vehicle, passive: Trace, controlled: Trace | None
) -> Standard:
    """Return the verdicts on a pair of runs by the manoeuvre's standard."""
    return Standard(
        maneuver.standard,
        _judged(maneuver, vehicle, passive),
        None if controlled is None else _judged(maneuver, vehicle, controlled),
    )


def _judged(maneuver: Maneuver, vehicle: Vehicle, trace: Trace) -> Judged:
    verdicts: list[Verdict] = []
    over = any(np.any(piece > 0) for (piece,) in pieces(trace.signals, "rollover"))
    if over and maneuver.standard != "none":
        # the run ended there: whatever else is asked for was not driven
        verdicts = standards.two_wheel_lift(trace.signals)
    elif trace.duration >= maneuver.duration_ns * 1e-9 - 1e-6:
        verdicts = standards.judge(maneuver.name, vehicle, trace.signals)
    return Judged(tuple(verdicts))


def measured(verdict: Verdict) -> str:
    """Return the measured value as text."""
    if not isfinite(verdict.value):
        return "rolled over"
    return f"{_number(verdict.value)} {verdict.unit}".strip()


def limit(verdict: Verdict) -> str:
    """Return the limit as text; empty if the figure has none."""
    return f"{_number(verdict.limit)} {verdict.unit}".strip() if isfinite(verdict.limit) else ""


def sentence(judged: Judged) -> str:
    """Return the verdict with its figures, in one line."""
    parts = [
        f"{verdict.criterion} {measured(verdict)}"
        + (f" (limit {limit(verdict)})" if limit(verdict) else "")
        for verdict in judged.criteria
    ]
    return f"{'passes' if judged.passed else 'fails'}: {', '.join(parts)}"


def lines(standard: Standard) -> Sequence[str]:
    """Return the verdicts as lines for a terminal; none if nothing was judged."""
    runs = [f"  {name:<10}  {sentence(judged)}" for name, judged in standard.runs()]
    return [standard.name, *runs] if runs else []


def _number(value: float) -> str:
    return f"{value:.3g}".replace("-", "−")
