"""Laws compared at equal effort: equal plant, knowledge, delays and noise.

Every law is designed from the same design model and bus, drives the same manoeuvre on the same
plant with the same seeds (so that every difference is paired), and is scaled to the same RMS
moment over these very runs. Better means less roll, RMS and peak, beyond the 95 % interval of the
paired differences, without a limit cycle, while moment, path error, steering and load transfer
are no worse.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from math import isfinite, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.typing import Progress
from hil.runs.experiment import plan
from hil.studies.effort import (
    FIGURES,
    BudgetError,
    Driven,
    PassiveRoll,
    at_budget,
    at_rest,
    driven,
    roll_without_control,
)


@dataclass(frozen=True, slots=True)
class Entry:
    """One law of the comparison.

    Attributes:
        name: as the table calls it.
        sensors: "roll_rate_only" (as in the paper), "all_sensors", or "" for none.
        keywords: what :func:`hil.runs.experiment.plan` is called with.
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
    Entry("hinf_delay", "roll_rate_only", {"law": "hinf_delay"}),
    Entry("hinf_nodelay", "roll_rate_only", {"law": "hinf_nodelay"}),
    Entry("hinf_event", "roll_rate_only", {"law": "hinf_event"}),
    Entry("ay_feedforward", "all_sensors", {"law": "ay_feedforward"}),
    Entry("rate_feedforward", "all_sensors", {"law": "rate_feedforward"}),
    Entry("lqr, feedback only", "all_sensors", {"law": "lqr", "feedforward": False}),
    Entry("hinf, feedback only", "all_sensors", {"law": "hinf", "feedforward": False}),
    Entry("smc, feedback only", "all_sensors", {"law": "smc", "feedforward": False}),
    Entry("lqr", "all_sensors", {"law": "lqr"}),
    Entry("hinf", "all_sensors", {"law": "hinf"}),
    Entry("smc", "all_sensors", {"law": "smc"}),
    Entry("lqg_delay", "all_sensors", {"law": "lqg_delay"}),
)
PRINTED = (
    Entry(
        "hinf_delay as printed",
        "roll_rate_only",
        {"law": "hinf_delay", "gains": "as_printed"},
        scaled=False,
    ),
    Entry(
        "hinf_event as printed",
        "roll_rate_only",
        {"law": "hinf_event", "gains": "as_printed"},
        scaled=False,
    ),
)
"""Laws whose printed gains are for one vehicle: van_2021."""
REFERENCE = "hinf_delay"
"""The paper's structure, tuned on the plant at hand: its effort is the budget of all."""


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
"""How much worse a figure may be and still count as no worse, as share of the reference."""
EFFORT_TOLERANCE = 0.02
"""How far from the budget the mean RMS moment of a scaled law may be, as share of it."""
SEARCHED = 20
"""How many of the runs the factor of a law is searched on."""
CONFIDENCE = 1.96


@dataclass(frozen=True, slots=True)
class Row:
    """Results of one law.

    Attributes:
        entry: the law.
        factor: on its moment, to meet the budget; 1 where it is not scaled.
        figures: runs by :data:`FIGURES`, (runs, 8); NaN where it did not run.
        refused: why it cannot be compared, as that it did not run or misses the budget, or empty.
        cycles: how many runs were a limit cycle.
        oscillates: whether that is more than chance explains.
    """

    entry: Entry
    factor: float
    figures: NDArray[np.float64]
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
        """Return "better", "worse", "equal", why it is none, or what pays for less roll."""
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
    half = CONFIDENCE * float(np.std(difference, ddof=1)) / sqrt(len(difference))
    return Difference(mean, mean - half, mean + half)


def compare(
    scenario: str,
    *,
    vehicle: str = "van_2021",
    bus: str = "500k",
    runs: int = 200,
    entries: Sequence[Entry] | None = None,
    conditions: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Drive every law ``runs`` times and return the rows.

    The budget is the RMS moment of the reference law at the highest tenth of its designed gain
    that makes no limit cycle on this plant; where that is not the whole gain, the law as designed
    is one more row.

    Args:
        scenario: manoeuvre.
        vehicle: preset or file.
        bus: profile.
        runs: seeds 0 to ``runs`` − 1, the same for every law; at least 2.
        entries: laws, the reference among them; by default all, with the printed gains on the
            vehicle that they are for.
        conditions: further keywords of :func:`hil.runs.experiment.plan` that hold for all laws.
        progress: called with the law's name and the share done.

    Raises:
        CanrollError: unknown names, fewer than two runs, or a reference that makes a limit cycle
            at any gain.
    """
    if runs < 2:
        raise CanrollError(f"--runs must be at least 2 for paired intervals, got {runs}")
    if entries is None:
        entries = (*ENTRIES, *(PRINTED if vehicle == "van_2021" else ()))
    common: dict[str, Any] = {"vehicle": vehicle, "bus": bus, **(conditions or {})}
    settings, controller = plan(scenario, **common, law=REFERENCE)
    passive = roll_without_control(settings, controller, runs)
    tried = []

    def reference_at(factor: float) -> Driven:
        tried.append(driven(settings, controller, passive, factor=factor))
        return tried[-1]

    try:
        found = at_rest(reference_at)
    except CanrollError as error:
        raise CanrollError(f"{REFERENCE}, the reference for the RMS moment, is {error}") from error
    rows = []
    for done, entry in enumerate(entries):
        if progress is not None:
            progress(entry.name, done / len(entries))
        if entry.name != REFERENCE:
            rows.append(_row(entry, scenario, common, passive, found.effort))
            continue
        if found.factor < 1.0:
            designed = replace(entry, name=f"{REFERENCE} as designed", scaled=False)
            rows.append(_of(designed, tried[0]))
        rows.append(_of(entry, found))
    return Comparison(tuple(rows), REFERENCE, found.effort, runs, bus, vehicle, scenario)


def _row(
    entry: Entry,
    scenario: str,
    common: Mapping[str, Any],
    passive: Sequence[PassiveRoll],
    budget: float,
) -> Row:
    try:
        settings, controller = plan(scenario, **{**common, **entry.keywords})
    except CanrollError as error:
        return Row(entry, 1.0, np.full((len(passive), len(FIGURES)), np.nan), str(error))
    if entry.stiffer_bar:
        plant = settings.vehicle.plant
        stiffer = replace(plant, roll_stiffness=entry.stiffer_bar * plant.roll_stiffness)
        settings = replace(settings, vehicle=replace(settings.vehicle, plant=stiffer))
    if not entry.scaled:
        return _of(entry, driven(settings, controller, passive))
    refused = ""
    try:
        found = at_budget(
            lambda factor: driven(settings, controller, passive[:SEARCHED], factor=factor), budget
        )
    except BudgetError as error:
        found, refused = error.nearest, str(error)
    if len(passive) > SEARCHED:
        found = driven(settings, controller, passive, factor=found.factor)
    off = found.effort / budget - 1.0
    if not refused and abs(off) > EFFORT_TOLERANCE:
        refused = f"misses the RMS moment by {100 * off:+.1f} %"
    return _of(entry, found, refused)


def _of(entry: Entry, found: Driven, refused: str = "") -> Row:
    return Row(entry, found.factor, found.figures, refused, found.cycles, found.oscillates)


def table(comparison: Comparison) -> list[str]:
    """Return the comparison as a Markdown table, wins and losses alike."""
    base = next(row for row in comparison.rows if row.entry.name == "passive")
    lines = [
        "| law | sensors | factor | roll RMS | roll max | moment RMS | moment max | NLT front "
        "| path error | against the reference, roll RMS [95 %] | verdict |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- | --- |",
    ]
    for row in comparison.rows:
        if not row.ran:
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
            "limit_cycles": row.cycles,
            "verdict": comparison.verdict(row),
            **{
                figure: value if isfinite(value := row.mean(figure)) else None for figure in FIGURES
            },
        }
        for row in comparison.rows
    ]
