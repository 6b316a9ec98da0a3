"""Laws compared at equal effort: equal plants, knowledge, delays and noise.

Every law is designed from the same design model and bus, drives the same manoeuvre on the same
population of plants with the same seeds (so that every difference is paired), and is scaled to the
same RMS moment over the same runs. Better means less roll, RMS and peak, beyond the 95 % interval
of the paired differences, without a limit cycle, while moment, path error, steering and load
transfer are no worse. The distance of each law to the bound of :mod:`canroll.studies.bound` is
given as well: the least roll possible with that effort.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, replace
from math import degrees, inf, isfinite, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.cases.execution import IN_TURN, Cases
from canroll.cases.identity import identity
from canroll.errors import CanrollError
from canroll.runs.experiment import drive, plan
from canroll.runs.metrics import rms
from canroll.runs.result import Settings
from canroll.setup.choices import PASSIVE
from canroll.setup.controller import PreparedController
from canroll.studies.effort import (
    FIGURES,
    MOMENT_RMS,
    BudgetError,
    EffortRun,
    Passive,
    at_budget,
    at_rest,
    driven,
    without_control,
)
from canroll.studies.variation import NONE, population
from plant_sim.bodies import own_body


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


ENTRIES = (
    EffortEntry("passive", "", {"law": "passive"}, scaled=False),
    EffortEntry("best passive bar", "", {"law": "passive"}, scaled=False, best_bar=True),
    EffortEntry("hinf_delay", "roll_rate_only", {"law": "hinf_delay"}),
    EffortEntry("hinf_nodelay", "roll_rate_only", {"law": "hinf_nodelay"}),
    EffortEntry("hinf_event", "roll_rate_only", {"law": "hinf_event"}),
    EffortEntry("plain_feedforward", "all_sensors", {"law": "plain_feedforward"}),
    EffortEntry("ay_feedforward", "all_sensors", {"law": "ay_feedforward"}),
    EffortEntry("rate_feedforward", "all_sensors", {"law": "rate_feedforward"}),
    EffortEntry("lqr, feedback only", "all_sensors", {"law": "lqr", "feedforward": False}),
    EffortEntry("smc, feedback only", "all_sensors", {"law": "smc", "feedforward": False}),
    EffortEntry("lqr", "all_sensors", {"law": "lqr"}),
    EffortEntry("hinf", "all_sensors", {"law": "hinf"}),
    EffortEntry("smc", "all_sensors", {"law": "smc"}),
    EffortEntry("lqg_delay", "all_sensors", {"law": "lqg_delay"}),
    EffortEntry("steering_lead", "all_sensors", {"law": "steering_lead"}),
)
PRINTED = (
    EffortEntry(
        "hinf_delay as printed",
        "roll_rate_only",
        {"law": "hinf_delay", "gains": "as_printed", "unverified": True},
        scaled=False,
    ),
    EffortEntry(
        "hinf_event as printed",
        "roll_rate_only",
        {"law": "hinf_event", "gains": "as_printed", "unverified": True},
        scaled=False,
    ),
)
"""Laws whose printed gains are for one vehicle: van_2021."""
REFERENCE = "plain_feedforward"
"""The default reference: it needs neither a model nor a prediction."""
UPRIGHT_SHARE = 0.5
"""Effort by default, as share of the RMS of m h a_y, the moment that holds the body upright."""


ROLL = FIGURES[:2]
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
CONFIDENCE = 1.96


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


@dataclass(frozen=True, slots=True)
class Difference:
    """Paired difference from the reference as a fraction of its mean, with its 95 % interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class EffortComparison:
    """The rows, the reference among them and the common RMS moment, N·m."""

    rows: tuple[EffortRow, ...]
    reference: str
    budget: float
    runs: int
    bus: str
    vehicle: str
    scenario: str

    def against_reference(self, row: EffortRow, figure: str) -> Difference:
        """Return the paired difference of ``figure`` from the reference."""
        column = FIGURES.index(figure)
        base = next(r for r in self.rows if r.entry.name == self.reference).figures[:, column]
        return paired(row.figures[:, column], base)

    def verdict(self, row: EffortRow) -> str:
        """Return "better", "worse" or "equal", why there is no verdict, or what less roll costs."""
        if row.entry.name == self.reference:
            return "reference"
        if row.refused:
            return row.refused
        if row.oscillates:
            return f"limit cycle in {row.cycles} of {self.runs} runs"
        roll = [self.against_reference(row, figure) for figure in ROLL]
        if any(difference.low > 0.0 for difference in roll):
            if any(difference.high < 0.0 for difference in roll):
                return "mixed"
            less = self.against_reference(row, "moment_rms_nm").high < -TOLERANCE
            return "more roll for less moment" if less else "worse"
        if not all(difference.high < 0.0 for difference in roll):
            return "equal"
        paid = [
            word
            for figure, word in NO_WORSE.items()
            if self.against_reference(row, figure).low > TOLERANCE
        ]
        return f"less roll, but more {', '.join(paid)}" if paid else "better"


def paired(values: NDArray[np.float64], base: NDArray[np.float64]) -> Difference:
    """Return the mean of ``values`` − ``base`` with its 95 % interval, over the mean of base."""
    size = float(np.mean(base)) or 1.0
    difference = (values - base) / size
    mean = float(np.mean(difference))
    half = inf
    if len(difference) > 1:
        half = CONFIDENCE * float(np.std(difference, ddof=1)) / sqrt(len(difference))
    return Difference(mean, mean - half, mean + half)


def half_upright(scenario: str, **choices: Any) -> float:  # noqa: ANN401
    """Return half the RMS of m h a_y without control, N·m, to two digits: the default effort.

    Args:
        scenario: manoeuvre.
        choices: keywords of :func:`canroll.runs.experiment.plan`.
    """
    settings, controller = plan(scenario, **{**choices, "law": PASSIVE})
    lateral = drive(settings, controller, enabled=False).signals["ay"]
    return float(f"{UPRIGHT_SHARE * settings.vehicle.plant.roll_arm * rms(lateral):.2g}")


def compare(
    scenario: str,
    *,
    vehicle: str = "van_2021",
    bus: str = "500k",
    runs: int = 200,
    entries: Sequence[EffortEntry] | None = None,
    reference: str = REFERENCE,
    effort: float | None = None,
    spread: Mapping[str, float] = NONE,
    conditions: Mapping[str, Any] | None = None,
    label: str = "laws",
    cases: Cases = IN_TURN,
) -> EffortComparison:
    """Drive every law ``runs`` times and return the rows.

    If the effort is that of the reference, the reference is driven at the largest tenth of its
    designed gain without a limit cycle on this plant; if that is not the full gain, the law as
    designed is an additional row.

    Args:
        scenario: manoeuvre.
        vehicle: preset or file.
        bus: profile.
        runs: number of vehicles of the population, the same for every law; at least 2.
        entries: laws including the reference; by default all, with the printed gains on their
            vehicle.
        reference: law with which the others are compared.
        effort: common RMS moment, N·m; by default that of the reference as designed.
        spread: of the population, see :mod:`canroll.studies.variation`; by default equal vehicles.
        conditions: further keywords of :func:`canroll.runs.experiment.plan` for all laws.
        label: the activity, for the progress.
        cases: what drives the laws; of a single one, the passive vehicle and the reference too.

    Raises:
        CanrollError: unknown names, fewer than two runs, or a reference with a limit cycle at any
            gain.
    """
    if runs < 2:
        raise CanrollError(f"--runs must be at least 2 for paired intervals, got {runs}")
    if entries is None:
        entries = (*ENTRIES, *(PRINTED if vehicle == "van_2021" else ()))
    common: dict[str, Any] = {"vehicle": vehicle, "bus": bus, **(conditions or {})}
    settings, controller = plan(scenario, **common, law=PASSIVE)
    own_body(settings.plant, "a population of vehicles")
    base = next((entry for entry in entries if entry.name == reference), None)
    if base is None:
        raise CanrollError(f"{reference}, the reference, is not among the compared laws")
    picked = cases.picked(entries)
    entries = [e for e in entries if e in picked or e is base or e.name == PASSIVE]
    passive = without_control(population(settings, runs, spread), controller)
    driver = _Driver(scenario, common, runs, spread, passive)
    at_reference: list[EffortRow] = []
    if effort is None:
        effort, at_reference = driver.reference(base)
    study = cases.of(
        identity(settings, controller)
        | {"conditions": conditions, "laws": entries, "reference": reference}
        | {"runs": runs, "spread": dict(spread), "effort": effort}
    )
    common_driver = study.engine.common(driver)
    others = [entry for entry in entries if entry is not base or not at_reference]
    driven = study.rows(label, law_row, [(common_driver, entry, effort) for entry in others])
    rows: list[EffortRow] = []
    for entry in entries:
        rows += [next(driven)] if entry in others else at_reference
    return EffortComparison(tuple(rows), reference, effort, runs, bus, vehicle, scenario)


def law_row(driver: "_Driver", entry: EffortEntry, effort: float) -> EffortRow:
    """Return the results of a law at ``effort``, N·m."""
    return driver.row(entry, effort)


def with_stiffer_bar(settings: Settings, factor: float) -> Settings:
    """Return ``settings`` with a plant of ``factor`` times its roll stiffness."""
    plant = settings.vehicle.plant
    stiffer = replace(plant, roll_stiffness=factor * plant.roll_stiffness)
    return replace(settings, vehicle=replace(settings.vehicle, plant=stiffer))


@dataclass(frozen=True, slots=True)
class _Driver:
    """Conditions common to all laws: manoeuvre, choices, and a population with its passive roll."""

    scenario: str
    common: Mapping[str, Any]
    runs: int
    spread: Mapping[str, float]
    passive: Sequence[Passive]

    def plan(self, entry: EffortEntry) -> tuple[list[Settings], PreparedController]:
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


def table(comparison: EffortComparison) -> list[str]:
    """Return the comparison as a Markdown table, better and worse results alike."""
    base = next(row for row in comparison.rows if row.entry.name == "passive")
    lines = [
        "| law | sensors | factor | roll RMS | worst vehicle | roll max | above the bound "
        "| moment RMS | moment max | NLT front | path error "
        "| against the reference, roll RMS [95 %] | verdict |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- | --- |",
    ]
    for row in comparison.rows:
        if not row.ran:
            lines.append(f"| {row.entry.name} | {row.entry.sensors} {'| ' * 10}| {row.refused} |")
            continue
        roll = [row.mean(figure) / base.mean(figure) - 1.0 for figure in ROLL]
        worst = np.max(row.figures[:, 0] / base.figures[:, 0]) - 1.0
        above = f"{100 * row.above_bound:+.1f} %" if isfinite(row.above_bound) else ""
        against = comparison.against_reference(row, ROLL[0])
        mean, low, high = (100.0 * value for value in astuple(against))
        lines.append(
            f"| {row.entry.name} | {row.entry.sensors} | {row.factor:.2f} "
            f"| {row.mean('roll_rms_deg'):.2f}° ({100 * roll[0]:+.0f} %) | {100 * worst:+.0f} % "
            f"| {row.mean('roll_max_deg'):.2f}° ({100 * roll[1]:+.0f} %) | {above} "
            f"| {row.mean('moment_rms_nm'):.0f} | {row.mean('moment_max_nm'):.0f} "
            f"| {row.mean('nlt_front_max'):.3f} | {row.mean('path_error_max_m'):.2f} m "
            f"| {mean:+.1f} % [{low:+.1f}, {high:+.1f}] | {comparison.verdict(row)} |"
        )
    return lines


def to_json(comparison: EffortComparison) -> list[dict[str, Any]]:
    """Return the rows as plain numbers."""
    rows = []
    for row in comparison.rows:
        against = comparison.against_reference(row, ROLL[0])
        numbers = {
            **{figure: row.mean(figure) for figure in FIGURES},
            "bound_roll_rms_deg": float(np.mean(row.bound)),
            "above_bound": row.above_bound,
            **{f"against_reference_{name}": value for name, value in asdict(against).items()},
        }
        rows.append(
            {
                "law": row.entry.name,
                "sensors": row.entry.sensors,
                "factor": row.factor,
                "refused": row.refused,
                "limit_cycles": row.cycles,
                "verdict": comparison.verdict(row),
                **{name: value if isfinite(value) else None for name, value in numbers.items()},
            }
        )
    return rows
