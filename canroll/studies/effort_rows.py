"""One law of a comparison at equal effort: scaled to the effort, and driven on all plants."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.runs.experiment import plan
from canroll.runs.result import Run
from canroll.setup.choices import PASSIVE
from canroll.setup.controller import Controller
from canroll.studies.effort import (
    FIGURES,
    MOMENT_RMS,
    BudgetError,
    EffortRun,
    Passive,
    at_budget,
    at_rest,
    driven,
)
from canroll.studies.variation import population

NO_WORSE = {
    "moment_rms_nm": "RMS moment",
    "moment_max_nm": "peak moment",
    "path_error_max_m": "path error",
    "nlt_front_max": "load transfer in front",
    "nlt_rear_max": "load transfer in the rear",
    "steer_rms_deg": "steering",
}
"""Quantities that must not get worse, as text."""
TOLERANCE = 0.01
"""Tolerance within which a figure counts as no worse, relative to the reference."""
EFFORT_TOLERANCE = 0.02
"""Tolerance of the mean RMS moment of a scaled law, relative to the budget."""
SEARCHED = 20
"""Number of runs on which the factor of a law is searched."""
STIFFER = tuple(tenth / 10 for tenth in range(20, 10, -1))
"""Factors on the roll stiffness tried for a passive bar; twice is the practical maximum."""


@dataclass(frozen=True, slots=True)
class EffortEntry:
    """One law of the comparison.

    Attributes:
        name: its name in the table.
        sensors: "roll_rate_only" (as in the paper), "all_sensors", or "" for none.
        keywords: keywords for :func:`canroll.runs.experiment.plan`.
        scaled: whether it is scaled to the common budget; a paper's law as printed is not.
        best_bar: the best passive bar instead of a law, see :meth:`_Driver.bar`.
    """

    name: str
    sensors: str
    keywords: Mapping[str, Any]
    scaled: bool = True
    best_bar: bool = False


@dataclass(frozen=True, slots=True)
class EffortRow:
    """Results of one law.

    Attributes:
        entry: the law.
        factor: factor on its moment to meet the budget, 1 if not scaled; for a passive bar on the
            roll stiffness.
        figures: runs by :data:`FIGURES`, (runs, 8); NaN where it did not run.
        bound: least RMS roll angle at each run's effort, (runs,), deg; NaN without control.
        refused: reason why it is not compared, such as a failed run or a missed budget, or
            empty.
        cycles: number of runs with a limit cycle.
        oscillates: whether that is more than expected by chance.
    """

    entry: EffortEntry
    factor: float
    figures: NDArray[np.float64]
    bound: NDArray[np.float64]
    refused: str = ""
    cycles: int = 0
    oscillates: bool = False

    @property
    def ran(self) -> bool:
        """Whether it ran."""
        return bool(np.all(np.isfinite(self.figures)))

    def mean(self, figure: str) -> float:
        """Mean of a figure over the runs."""
        return float(np.mean(self.figures[:, FIGURES.index(figure)]))

    @property
    def above_bound(self) -> float:
        """Mean RMS roll angle relative to the bound at the same effort, minus 1.

        Infinite if that effort could hold the body upright.
        """
        least = float(np.mean(self.bound))
        return self.mean("roll_rms_deg") / least - 1.0 if least else inf


def with_stiffer_bar(settings: Run, factor: float) -> Run:
    """Return ``settings`` with a plant of ``factor`` times its roll stiffness."""
    plant = settings.vehicle.plant
    stiffer = replace(plant, roll_stiffness=factor * plant.roll_stiffness)
    return replace(settings, vehicle=replace(settings.vehicle, plant=stiffer))


@dataclass(frozen=True, slots=True)
class LawDriver:
    """Conditions common to all laws: manoeuvre, choices, and a population with its passive roll."""

    scenario: str
    common: Mapping[str, Any]
    runs: int
    spread: Mapping[str, float]
    passive: Sequence[Passive]

    def plan(self, entry: EffortEntry) -> tuple[list[Run], Controller]:
        """Return the runs of a law, and its controller."""
        settings, controller = plan(self.scenario, **{**self.common, **entry.keywords})
        return population(settings, self.runs, self.spread), controller

    def bar(self, entry: EffortEntry) -> EffortRow:
        """Return the results of the best passive bar; its factor is on the roll stiffness.

        It is the stiffest, in tenths and at most twice as stiff, with path error, steering and load
        transfer no worse.
        """
        settings, controller = plan(self.scenario, **{**self.common, **entry.keywords})
        columns = [FIGURES.index(name) for name in NO_WORSE]

        def at(factor: float) -> EffortRun:
            where = population(with_stiffer_bar(settings, factor), self.runs, self.spread)
            return replace(driven(where, controller, self.passive), factor=factor)

        without = at(1.0)
        allowed = (1.0 + TOLERANCE) * np.mean(without.figures[:, columns], axis=0)
        for factor in STIFFER:
            run = at(factor)
            if np.all(np.mean(run.figures[:, columns], axis=0) <= allowed):
                return self._of(entry, run)
        return self._of(entry, without)

    def reference(self, entry: EffortEntry) -> tuple[float, list[EffortRow]]:
        """Return the effort of the reference without limit cycle, N·m, and its rows."""
        where, controller = self.plan(entry)
        tried = []

        def at(factor: float) -> EffortRun:
            tried.append(driven(where, controller, self.passive, factor=factor))
            return tried[-1]

        try:
            run = at_rest(at)
        except CanrollError as error:
            raise CanrollError(f"{entry.name}, the reference for the moment, is {error}") from error
        rows = []
        if run.factor < 1.0:
            designed = replace(entry, name=f"{entry.name} as designed", scaled=False)
            rows.append(self._of(designed, tried[0]))
        return run.effort, [*rows, self._of(entry, run)]

    def row(self, entry: EffortEntry, effort: float) -> EffortRow:
        """Return the results of a law at ``effort``, N·m, or at its designed effort."""
        if entry.best_bar:
            return self.bar(entry)
        try:
            where, controller = self.plan(entry)
        except CanrollError as error:
            nothing = np.full((self.runs, len(FIGURES)), np.nan)
            return EffortRow(entry, 1.0, nothing, nothing[:, 0], str(error))
        if not entry.scaled:
            return self._of(entry, driven(where, controller, self.passive))
        refused = ""
        some, roll = where[:SEARCHED], self.passive[:SEARCHED]
        try:
            run = at_budget(lambda factor: driven(some, controller, roll, factor=factor), effort)
        except BudgetError as error:
            run, refused = error.nearest, str(error)
        if self.runs > SEARCHED:
            run = driven(where, controller, self.passive, factor=run.factor)
        off = run.effort / effort - 1.0
        if not refused and abs(off) > EFFORT_TOLERANCE:
            refused = f"misses the RMS moment by {100 * off:+.1f} %"
        return self._of(entry, run, refused)

    def _of(self, entry: EffortEntry, run: EffortRun, refused: str = "") -> EffortRow:
        efforts = run.figures[:, MOMENT_RMS]
        least = [
            degrees(passive.bound.at(effort))
            for passive, effort in zip(self.passive, efforts, strict=True)
        ]
        silent = entry.keywords["law"] == PASSIVE
        bound = np.full(len(least), np.nan) if silent else np.array(least)
        return EffortRow(entry, run.factor, run.figures, bound, refused, run.cycles, run.oscillates)
