"""Verdict of a run by the manoeuvre's standard, and of a pair by that, roll and rollover."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import isfinite, sqrt
from typing import Any

import numpy as np

from canroll.plant_sim.driving import standards
from canroll.plant_sim.driving.maneuvers import Maneuver
from canroll.plant_sim.driving.standards import Verdict
from canroll.plant_sim.world.spool import pieces
from canroll.runs.limit_cycle import LimitCycle
from canroll.runs.metrics import BY_KEY, LEAST_ROLL_DEG, METRICS, Metric, Metrics, helps
from canroll.runs.trace import Trace
from canroll.vehicles import Vehicle

WORSE = 1.05
"""Ratio of a metric with control to that without, above which it is a side effect."""
FELT = 0.015 / sqrt(2)
"""RMS of the vertical acceleration weighted by W_k that half of alert people just feel, m/s²: a
sine with the peak of ISO 2631-1:1997, C.3."""


@dataclass(frozen=True, slots=True)
class StandardJudgement:
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
    passive: StandardJudgement
    controlled: StandardJudgement | None

    @property
    def short_name(self) -> str:
        """The name without the deviations."""
        return self.name.partition(",")[0]

    def runs(self) -> list[tuple[str, StandardJudgement]]:
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


@dataclass(frozen=True, slots=True)
class StandardOutcome:
    """One manoeuvre without and with control (None for the law "passive"), compared."""

    passive: Metrics
    controlled: Metrics | None
    limit_cycle: LimitCycle | None
    standard: Standard

    @property
    def rolls(self) -> bool:
        """Whether there is any roll angle to reduce."""
        return self.passive.roll_max_deg >= LEAST_ROLL_DEG

    @property
    def reduction(self) -> float | None:
        """Reduction of the largest roll angle by control, as a fraction; None without any roll."""
        if self.controlled is None or not self.rolls:
            return None
        return 1 - self.controlled.roll_max_deg / self.passive.roll_max_deg

    @property
    def prevents_rollover(self) -> bool:
        """Whether the vehicle rolls over without control only."""
        return (
            self.controlled is not None and self.passive.rollover and not self.controlled.rollover
        )

    @property
    def helps(self) -> bool | None:
        """Whether control prevents a rollover, or reduces both RMS and largest roll angle.

        False with a limit cycle or a rollover; None without control or without any roll.
        """
        active = self.controlled
        if active is None:
            return None
        if active.rollover or self.limit_cycle is not None:
            return False
        if not self.rolls:
            return None
        return bool(helps(asdict(self.passive), asdict(active), oscillates=False))

    @property
    def pays(self) -> tuple[str, ...]:
        """Side effects: metrics that control worsens by more than 5 %, as text."""
        active, passive = self.controlled, self.passive
        if active is None or not self.helps or self.prevents_rollover:
            return ()
        paid = [
            (each, getattr(active, each.key), getattr(passive, each.key))
            for each in METRICS
            if each.paid
        ]
        lifts = _lifts(active) and not _lifts(passive)
        worse = [_instead(*values) for values in paid if values[1] > WORSE * values[2]]
        return (*worse, *["a wheel leaves the road, which none of the passive car does"] * lifts)

    @property
    def wheels(self) -> str:
        """That control keeps all wheels on the road, if only it does; else empty."""
        keeps = self.controlled is not None and _lifts(self.passive) and not _lifts(self.controlled)
        return "; keeps the wheels on the road, which the passive car does not" if keeps else ""

    @property
    def ride(self) -> str:
        """The vertical ride where control makes it worse by more than 5 % and that is felt."""
        each = BY_KEY["ride_vertical_ms2"]
        after, before = (getattr(run, each.key, None) for run in (self.controlled, self.passive))
        if after is None or before is None or after <= max(WORSE * before, FELT):
            return ""
        change = f" ({100 * (after / before - 1):+.0f} %)" if before else ""
        return f"; {_instead(each, after, before)}{change}"

    @property
    def good(self) -> bool | None:
        """Whether control helps and the standard, if any, is met.

        False also where only the run without control meets the standard; None where neither
        does, with side effects, or if there is nothing to judge.
        """
        if self.helps is False or (self.fails_standard and self.standard.passive.passed):
            return False
        return None if self.fails_standard or self.pays else self.helps

    @property
    def sentence(self) -> str:
        """The answer in one line: headline, colon, grounds."""
        passive, active = self.passive, self.controlled
        if active is None:
            headline = "Without control" + " the vehicle rolls over" * passive.rollover
            angle = f"largest roll angle {passive.roll_max_deg:.2f}°"
            return self._judged(headline, angle, self.standard.passive)
        angle = (
            f"largest roll angle {active.roll_max_deg:.2f}° instead of {passive.roll_max_deg:.2f}°"
        )
        if self.reduction is not None:
            angle += f" ({-100 * self.reduction:+.0f} %)".replace("-", "−")
        angle += self.wheels
        if active.rollover:
            does = "does not prevent the" if passive.rollover else "causes a"
            return f"Control {does} rollover: {angle}"
        if self.limit_cycle is not None:
            return f"The loop is unstable, {self.limit_cycle}; {angle}"
        headline, grounds = "Control helps", angle
        if self.prevents_rollover:
            headline = "Control prevents the rollover"
        elif not self.rolls:
            headline = "No roll to reduce"
        elif self.pays:
            headline, grounds = "Mixed", f"{angle}, but {', '.join(self.pays)}"
        elif not self.helps:
            headline = "Control does not help"
            if active.roll_rms_deg >= passive.roll_rms_deg:
                rms = f"{active.roll_rms_deg:.3g}° instead of {passive.roll_rms_deg:.3g}°"
                grounds = f"RMS roll angle not reduced, {rms}; {angle}"
        return self._judged(headline, grounds + self.ride, self.standard.controlled)

    @property
    def fails_standard(self) -> bool:
        """Whether the run with control does not meet the manoeuvre's standard."""
        judged = self.standard.controlled
        return judged is not None and judged.passed is False

    def _judged(self, headline: str, grounds: str, judged: StandardJudgement | None) -> str:
        """Return headline and grounds with what of the standard is not met."""
        if judged is None or judged.passed is not False:
            return f"{headline}: {grounds}"
        lost = self.controlled is not None and self.standard.passive.passed
        met = "met only without it" if lost else "not met"
        unmet = ", ".join(measure(each) for each in judged.criteria if not each.passed)
        return f"{headline}, {self.standard.short_name} {met}: {unmet}; {grounds}"


def assess(
    maneuver: Maneuver, vehicle: Vehicle, passive: Trace, controlled: Trace | None
) -> Standard:
    """Return the verdicts on a pair of runs by the manoeuvre's standard."""
    return Standard(
        maneuver.standard,
        _judged(maneuver, vehicle, passive),
        None if controlled is None else _judged(maneuver, vehicle, controlled),
    )


def _judged(maneuver: Maneuver, vehicle: Vehicle, trace: Trace) -> StandardJudgement:
    verdicts: list[Verdict] = []
    over = any(np.any(piece > 0) for (piece,) in pieces(trace.signals, "rollover"))
    if over and maneuver.standard != "none":
        # the run ended there: whatever else is asked for was not driven
        verdicts = standards.two_wheel_lift(trace.signals)
    elif trace.duration >= maneuver.duration_ns * 1e-9 - 1e-6:
        verdicts = standards.judge(maneuver.name, vehicle, trace.signals)
    return StandardJudgement(tuple(verdicts))


def measured(verdict: Verdict) -> str:
    """Return the measured value as text."""
    if not isfinite(verdict.value):
        return "rolled over"
    return f"{_number(verdict.value)} {verdict.unit}".strip()


def limit(verdict: Verdict) -> str:
    """Return the limit as text; empty if the figure has none."""
    return f"{_number(verdict.limit)} {verdict.unit}".strip() if isfinite(verdict.limit) else ""


def measure(verdict: Verdict) -> str:
    """Return the criterion with its measured value and its limit as text."""
    if not isfinite(verdict.value):
        return f"{verdict.criterion}: rolled over"
    limit_text = f" (limit {limit(verdict)})" if limit(verdict) else ""
    return f"{verdict.criterion} {measured(verdict)}{limit_text}"


def sentence(judged: StandardJudgement) -> str:
    """Return the verdict with its figures, in one line."""
    parts = ", ".join(measure(verdict) for verdict in judged.criteria)
    return f"{'passes' if judged.passed else 'fails'}: {parts}"


def lines(standard: Standard) -> Sequence[str]:
    """Return the verdicts as lines for a terminal; none if nothing was judged."""
    runs = [f"  {name:<10}  {sentence(judged)}" for name, judged in standard.runs()]
    return [standard.name, *runs] if runs else []


def _lifts(run: Metrics) -> bool:
    """Whether a wheel leaves the road; a plant without wheel loads does not say so."""
    return any(load is not None and load >= 1 for load in (run.nlt_front_max, run.nlt_rear_max))


def _instead(metric: Metric, after: float, before: float) -> str:
    digits = metric.digits
    return f"{metric.label} {after:.{digits}f} instead of {before:.{digits}f} {metric.unit}"


def _number(value: float) -> str:
    return f"{value:.3g}".replace("-", "−")
