"""The contract by which laws are compared: equal plant, knowledge, delays, noise and effort.

Every law is designed from the same design model and bus, drives the same manoeuvre on the same
plant with the same seeds (so that every difference is paired), and is scaled to the same RMS
moment on seeds of their own. Better means less roll, RMS and peak, beyond the 95 % interval of the
paired differences, while peak moment, path error and load transfer are no worse.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import astuple, dataclass, replace
from math import isfinite, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from hil.controller import Controller
from hil.experiment import drive, plan
from hil.metrics import judge
from hil.result import Settings

FIGURES = (
    "roll_rms_deg",
    "roll_max_deg",
    "moment_rms_nm",
    "moment_max_nm",
    "path_error_max_m",
    "nlt_front_max",
    "nlt_rear_max",
)
ROLL = FIGURES[:2]
NO_WORSE = FIGURES[3:]
TOLERANCE = 0.01
"""How much worse a figure may be and still count as no worse, as share of the reference."""
BUDGET_TOLERANCE = 0.001
CALIBRATION_SEEDS = (100_001, 100_002, 100_003)
LARGEST_FACTOR = 3.99
UNIT_GAIN = 1 << 28
CONFIDENCE = 1.96

Report = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Entry:
    """One law of the comparison.

    Attributes:
        name: as the table calls it.
        sensors: "S1": the paper's, roll rate alone; "S2": all; "": no sensors at all.
        keywords: what :func:`hil.experiment.plan` is called with.
        scaled: to the common budget; a paper's law as printed is not.
        stiffer_bar: factor on the plant's roll stiffness instead of a law, or zero.
    """

    name: str
    sensors: str
    keywords: Mapping[str, Any]
    scaled: bool = True
    stiffer_bar: float = 0.0


ENTRIES = (
    Entry("passive", "", {"law": "passive"}, scaled=False),
    Entry("stiffer bar", "", {"law": "passive"}, scaled=False, stiffer_bar=1.3),
    Entry("hinf_delay", "S1", {"law": "hinf_delay"}),
    Entry("hinf_nodelay", "S1", {"law": "hinf_nodelay"}),
    Entry("hinf_event", "S1", {"law": "hinf_event"}),
    Entry("ay_feedforward", "S2", {"law": "ay_feedforward"}),
    Entry("rate_feedforward", "S2", {"law": "rate_feedforward"}),
    Entry("lqr, feedback only", "S2", {"law": "lqr", "feedforward": False}),
    Entry("hinf, feedback only", "S2", {"law": "hinf", "feedforward": False}),
    Entry("smc, feedback only", "S2", {"law": "smc", "feedforward": False}),
    Entry("lqr", "S2", {"law": "lqr"}),
    Entry("hinf", "S2", {"law": "hinf"}),
    Entry("smc", "S2", {"law": "smc"}),
    Entry("lqg_delay", "S2", {"law": "lqg_delay"}),
)
PRINTED = (
    Entry(
        "hinf_delay as printed", "S1", {"law": "hinf_delay", "gains": "as_printed"}, scaled=False
    ),
    Entry(
        "hinf_event as printed", "S1", {"law": "hinf_event", "gains": "as_printed"}, scaled=False
    ),
)
"""Laws whose printed gains are for one vehicle: van_2021."""
REFERENCE = "hinf_delay"
"""The paper's structure, tuned on the plant at hand: its effort is the budget of all."""


@dataclass(frozen=True, slots=True)
class Row:
    """What one law did.

    Attributes:
        entry: the law.
        factor: on its moment, to meet the budget; 1 where it is not scaled.
        figures: runs by :data:`FIGURES`, (runs, 7).
        refused: why it did not run, or empty.
    """

    entry: Entry
    factor: float
    figures: NDArray[np.float64]
    refused: str = ""

    def mean(self, figure: str) -> float:
        """Mean of a figure over the runs."""
        return float(np.mean(self.figures[:, FIGURES.index(figure)]))


@dataclass(frozen=True, slots=True)
class Difference:
    """Paired difference from the reference as share of its mean, with its 95 % interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """The rows, the reference among them and the common RMS moment, N·m."""

    rows: tuple[Row, ...]
    reference: str
    budget: float
    runs: int
    bus: str
    vehicle: str
    scenario: str

    def against_reference(self, row: Row, figure: str) -> Difference:
        """Return the paired difference of ``figure`` from the reference."""
        column = FIGURES.index(figure)
        base = next(r for r in self.rows if r.entry.name == self.reference).figures[:, column]
        return paired(row.figures[:, column], base)

    def verdict(self, row: Row) -> str:
        """Return "better", "worse", "equal", or which figures pay for less roll."""
        if row.entry.name == self.reference or row.refused:
            return ""
        roll = [self.against_reference(row, figure) for figure in ROLL]
        if any(difference.low > 0.0 for difference in roll):
            mixed = any(difference.high < 0.0 for difference in roll)
            return "mixed" if mixed else "worse"
        if not all(difference.high < 0.0 for difference in roll):
            return "equal"
        paid = [
            figure for figure in NO_WORSE if self.against_reference(row, figure).low > TOLERANCE
        ]
        return f"less roll, but more {', '.join(paid)}" if paid else "better"


def paired(values: NDArray[np.float64], base: NDArray[np.float64]) -> Difference:
    """Return the mean of ``values`` − ``base`` with its 95 % interval, over the mean of base."""
    size = float(np.mean(base)) or 1.0
    difference = (values - base) / size
    mean = float(np.mean(difference))
    half = CONFIDENCE * float(np.std(difference, ddof=1)) / sqrt(len(difference))
    return Difference(mean, mean - half, mean + half)


def figures_of(settings: Settings, controller: Controller, seed: int) -> NDArray[np.float64]:
    """Drive one seed and return its figures."""
    trace = drive(replace(settings, seed=seed), controller, enabled=settings.law != "passive")
    metrics = judge(trace)
    return np.array([getattr(metrics, name) for name in FIGURES])


def scaled(controller: Controller, factor: float) -> Controller:
    """Return the controller with its moment multiplied, at every speed of the schedule."""
    record = copy(controller.record)
    record.schedule_gain = [round(factor * UNIT_GAIN)] * len(record.schedule_gain)
    return replace(controller, record=record)


def factor_for_budget(settings: Settings, controller: Controller, budget: float) -> float:
    """Return the factor at which the RMS moment meets ``budget``, by bisection on own seeds.

    Raises:
        CanrollError: the law cannot be brought to the budget.
    """

    def excess(factor: float) -> float:
        moments = [
            figures_of(settings, scaled(controller, factor), seed)[FIGURES.index("moment_rms_nm")]
            for seed in CALIBRATION_SEEDS
        ]
        return float(np.mean(moments)) / budget - 1.0

    low, high = 0.0, 1.0
    while excess(high) < 0.0:
        low, high = high, 2.0 * high
        if high > LARGEST_FACTOR:
            high = LARGEST_FACTOR
            if excess(high) < 0.0:
                raise CanrollError(f"stays below the RMS moment of {budget:.0f} N·m")
            break
    for _ in range(14):
        middle = 0.5 * (low + high)
        found = excess(middle)
        if abs(found) < BUDGET_TOLERANCE:
            return middle
        low, high = (middle, high) if found < 0.0 else (low, middle)
    return 0.5 * (low + high)


def compare(
    scenario: str,
    *,
    vehicle: str = "van_2021",
    bus: str = "500k",
    runs: int = 200,
    entries: Sequence[Entry] | None = None,
    conditions: Mapping[str, Any] | None = None,
    progress: Report | None = None,
) -> Comparison:
    """Drive every law ``runs`` times and return the rows.

    The budget is the RMS moment of the reference law as designed.

    Args:
        scenario: manoeuvre.
        vehicle: preset or file.
        bus: profile.
        runs: seeds 0 to ``runs`` − 1, the same for every law; at least 2.
        entries: laws; by default all, with the printed gains on the vehicle that they are for.
        conditions: further keywords of :func:`hil.experiment.plan` that hold for all laws.
        progress: called with the law's name and the share done.

    Raises:
        CanrollError: unknown names, or fewer than two runs.
    """
    if runs < 2:
        raise CanrollError(f"--runs {runs}: paired intervals need at least 2")
    if entries is None:
        entries = (*ENTRIES, *(PRINTED if vehicle == "van_2021" else ()))
    common: dict[str, Any] = {"vehicle": vehicle, "bus": bus, **(conditions or {})}
    settings, controller = plan(scenario, **common, law=REFERENCE)
    column = FIGURES.index("moment_rms_nm")
    budget = float(
        np.mean([figures_of(settings, controller, seed)[column] for seed in CALIBRATION_SEEDS])
    )
    rows = []
    for done, entry in enumerate(entries):
        if progress is not None:
            progress(entry.name, done / len(entries))
        rows.append(_row(entry, scenario, common, runs=runs, budget=budget))
    return Comparison(tuple(rows), REFERENCE, budget, runs, bus, vehicle, scenario)


def _row(
    entry: Entry, scenario: str, common: Mapping[str, Any], *, runs: int, budget: float
) -> Row:
    nothing = np.full((runs, len(FIGURES)), np.nan)
    try:
        settings, controller = plan(scenario, **{**common, **entry.keywords})
        if entry.stiffer_bar:
            plant = settings.vehicle.plant
            stiffer = replace(plant, roll_stiffness=entry.stiffer_bar * plant.roll_stiffness)
            settings = replace(settings, vehicle=replace(settings.vehicle, plant=stiffer))
        factor = 1.0
        if entry.scaled:
            factor = factor_for_budget(settings, controller, budget)
            controller = scaled(controller, factor)
    except CanrollError as error:
        return Row(entry, 1.0, nothing, str(error))
    figures = np.array([figures_of(settings, controller, seed) for seed in range(runs)])
    return Row(entry, factor, figures)


def table(comparison: Comparison) -> list[str]:
    """Return the comparison as a Markdown table, wins and losses alike."""
    base = next(row for row in comparison.rows if row.entry.name == "passive")
    lines = [
        "| law | sensors | factor | roll RMS | roll max | moment RMS | moment max | NLT front "
        "| path error | against the reference, roll RMS [95 %] | verdict |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- | --- |",
    ]
    for row in comparison.rows:
        if row.refused:
            lines.append(
                f"| {row.entry.name} | {row.entry.sensors} | | | | | | | | | {row.refused} |"
            )
            continue
        roll = [row.mean(figure) / base.mean(figure) - 1.0 for figure in ROLL]
        against = comparison.against_reference(row, ROLL[0])
        mean, low, high = (100.0 * value for value in astuple(against))
        lines.append(
            f"| {row.entry.name} | {row.entry.sensors} | {row.factor:.2f} "
            f"| {row.mean('roll_rms_deg'):.2f}° ({100 * roll[0]:+.0f} %) "
            f"| {row.mean('roll_max_deg'):.2f}° ({100 * roll[1]:+.0f} %) "
            f"| {row.mean('moment_rms_nm'):.0f} | {row.mean('moment_max_nm'):.0f} "
            f"| {row.mean('nlt_front_max'):.3f} | {row.mean('path_error_max_m'):.2f} m "
            f"| {mean:+.1f} % [{low:+.1f}, {high:+.1f}] | {comparison.verdict(row)} |"
        )
    return lines


def to_json(comparison: Comparison) -> list[dict[str, Any]]:
    """Return the rows as plain numbers."""
    return [
        {
            "law": row.entry.name,
            "sensors": row.entry.sensors,
            "factor": row.factor,
            "refused": row.refused,
            "verdict": comparison.verdict(row),
            **{
                figure: value if isfinite(value := row.mean(figure)) else None for figure in FIGURES
            },
        }
        for row in comparison.rows
    ]
