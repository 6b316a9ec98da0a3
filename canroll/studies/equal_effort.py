"""Laws compared at equal effort: equal plants, knowledge, delays and noise.

Every law is designed from the same design model and bus, drives the same manoeuvre on the same
population of plants with the same seeds (so that every difference is paired), and is scaled to the
same RMS moment over the same runs. Better means less roll, RMS and peak, beyond the 95 % interval
of the paired differences, without a limit cycle, while moment, path error, steering and load
transfer are no worse. The distance of each law to the bound of :mod:`canroll.studies.bound` is
given as well: the least roll possible with that effort.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from math import inf, isfinite, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.cases.execution import IN_TURN, Cases
from canroll.cases.identity import identity
from canroll.errors import CanrollError
from canroll.plant_sim.bodies import own_body
from canroll.report.page import PageTable
from canroll.runs.experiment import drive, plan
from canroll.runs.metrics import rms
from canroll.setup.choices import PASSIVE
from canroll.studies.effort import (
    FIGURES,
    without_control,
)
from canroll.studies.effort_rows import (
    NO_WORSE,
    TOLERANCE,
    EffortEntry,
    EffortRow,
    LawDriver,
)
from canroll.studies.variation import NONE, population

OF_PAPERS, ALL = "roll_rate_only", "all_sensors"
"""What laws measure."""
ENTRIES = (
    EffortEntry("passive", "", {"law": "passive"}, scaled=False),
    EffortEntry("best passive bar", "", {"law": "passive"}, scaled=False, best_bar=True),
    *(
        EffortEntry(law, OF_PAPERS, {"law": law})
        for law in ("hinf_delay", "hinf_nodelay", "hinf_event")
    ),
    *(
        EffortEntry(law, ALL, {"law": law})
        for law in ("plain_feedforward", "ay_feedforward", "rate_feedforward")
    ),
    *(
        EffortEntry(f"{law}, feedback only", ALL, {"law": law, "feedforward": False})
        for law in ("lqr", "smc")
    ),
    *(
        EffortEntry(law, ALL, {"law": law})
        for law in ("lqr", "hinf", "smc", "lqg_delay", "steering_lead")
    ),
)
PRINTED = tuple(
    EffortEntry(
        f"{law} as printed",
        OF_PAPERS,
        {"law": law, "gains": "as_printed", "unverified": True},
        scaled=False,
    )
    for law in ("hinf_delay", "hinf_event")
)
"""Laws whose printed gains are for one vehicle: van_2021."""
REFERENCE = "plain_feedforward"
"""The default reference: it needs neither a model nor a prediction."""
UPRIGHT_SHARE = 0.5
"""Effort by default, as share of the RMS of m h a_y, the moment that holds the body upright."""


ROLL = FIGURES[:2]
CONFIDENCE = 1.96


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
    driver = LawDriver(scenario, common, runs, spread, passive)
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
    driven = study.rows("laws", LawDriver.row, [(common_driver, entry, effort) for entry in others])
    rows: list[EffortRow] = []
    for entry in entries:
        rows += [next(driven)] if entry in others else at_reference
    name = str(settings.vehicles["vehicle"])
    return EffortComparison(tuple(rows), reference, effort, runs, bus, name, scenario)


HEAD = (
    *("law", "sensors", "factor", "roll RMS", "worst vehicle", "roll max", "above the bound"),
    *("moment RMS", "moment max", "NLT front", "path error"),
    *("against the reference, roll RMS [95 %]", "verdict"),
)


def table(comparison: EffortComparison) -> PageTable:
    """Return the comparison as texts, better and worse results alike."""
    base = next(row for row in comparison.rows if row.entry.name == "passive")
    rows = []
    for row in comparison.rows:
        if not row.ran:
            rows.append((row.entry.name, row.entry.sensors, *[""] * 10, row.refused))
            continue
        roll = [row.mean(figure) / base.mean(figure) - 1.0 for figure in ROLL]
        worst = np.max(row.figures[:, 0] / base.figures[:, 0]) - 1.0
        against = comparison.against_reference(row, ROLL[0])
        mean, low, high = (100.0 * value for value in astuple(against))
        rows.append(
            (
                *(row.entry.name, row.entry.sensors, f"{row.factor:.2f}"),
                f"{row.mean('roll_rms_deg'):.2f}° ({100 * roll[0]:+.0f} %)",
                f"{100 * worst:+.0f} %",
                f"{row.mean('roll_max_deg'):.2f}° ({100 * roll[1]:+.0f} %)",
                f"{100 * row.above_bound:+.1f} %" if isfinite(row.above_bound) else "",
                *(f"{row.mean('moment_rms_nm'):.0f}", f"{row.mean('moment_max_nm'):.0f}"),
                *(f"{row.mean('nlt_front_max'):.3f}", f"{row.mean('path_error_max_m'):.2f} m"),
                f"{mean:+.1f} % [{low:+.1f}, {high:+.1f}]",
                comparison.verdict(row),
            )
        )
    return PageTable("", HEAD, rows)


def to_json(comparison: EffortComparison) -> dict[str, Any]:
    """Return the comparison as plain data."""
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
    return {
        "scenario": comparison.scenario,
        "vehicle": comparison.vehicle,
        "bus": comparison.bus,
        "runs": comparison.runs,
        "reference": comparison.reference,
        "effort_nm": comparison.budget,
        "rows": rows,
    }
