"""Influences on the draws: ranks, first-order indices, what separates failures from the rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata, spearmanr

from canroll.errors import CanrollError
from canroll.extensions.campaign.plan import GOOD, CampaignPlan, Columns
from canroll.extensions.campaign.summary import Summary, count_of, reduction, taken
from canroll.gain_gen.analysis.family import Condition, family
from canroll.gain_gen.calibration.dequantise import dequantise
from canroll.gain_gen.models.task import Task
from canroll.runs.experiment import delay_of

BINS = 20
LEAST_BIN = 10
"""Draws of a bin, at least."""
LEAST_FAILED = 5
"""Least number of failing draws for a statement about what predicts them."""
MARGIN_DRAWS = 60
"""Failing draws, and as many good ones, whose linear margins are computed."""
MARGINS = ("gain margin (dB)", "phase margin (deg)", "modulus margin 1/Ms")


@dataclass(frozen=True, slots=True)
class Influence:
    """How the draws depend on one quantity.

    Attributes:
        name: the quantity.
        rank: Spearman's correlation with the largest roll angle with control; None without order.
        first_order: share of that angle's variance which the quantity explains (Sobol's first-order
            index, from the draws' conditional means).
        rank_reduction: Spearman's correlation with the reduction of the roll angle by control.
        separates: probability that the quantity is farther to one side in a failing draw than in a
            good one; 0.5: no information; None with few failures, or without order.
    """

    name: str
    rank: float | None
    first_order: float
    rank_reduction: float | None
    separates: float | None


def influences(plan: CampaignPlan, summary: Summary) -> list[Influence]:
    """Return the influence of every drawn quantity, the largest first-order index first."""
    rows, failed = summary.sample, summary.failed
    roll, less = rows["controlled_roll_max_deg"], reduction(rows)
    ranked = []
    for name in plan.space.names:
        values = rows[name]
        ordered = values.dtype != object
        ranked.append(
            Influence(
                name,
                _rank(values, roll) if ordered else None,
                first_order(values, roll),
                _rank(values, less) if ordered else None,
                separation(failed[name], _good(rows)[name]) if ordered and failed else None,
            )
        )
    return sorted(ranked, key=lambda each: -each.first_order)


def _rank(values: NDArray[np.float64], figure: NDArray[np.float64]) -> float | None:
    if len(values) < 3 or not np.ptp(values) or not np.ptp(figure):
        return None
    return float(spearmanr(values, figure).statistic)


def first_order(values: NDArray[np.float64], figure: NDArray[np.float64]) -> float:
    """Return the share of the variance of ``figure`` that the mean given ``values`` explains.

    Numbers are binned by rank (Plischke, Borgonovo and Smith 2013), text by value. The bias of a
    finite number of draws is subtracted (Kelley's ε²); at least 0.
    """
    if values.dtype == object:
        groups = np.unique(values.astype(str), return_inverse=True)[1]
    else:
        bins = max(1, min(BINS, len(values) // LEAST_BIN))
        groups = np.minimum((rankdata(values) - 1) * bins // len(values), bins - 1).astype(np.int64)
    counts = np.bincount(groups)
    bins, total = int(np.sum(counts > 0)), float(np.sum((figure - figure.mean()) ** 2))
    if bins < 2 or total == 0.0 or len(values) <= bins:
        return 0.0
    means = np.bincount(groups, figure) / np.maximum(counts, 1)
    between = float(np.sum(counts * (means - figure.mean()) ** 2))
    noise = (total - between) / (len(values) - bins)
    return max(0.0, (between - (bins - 1) * noise) / total)


def separation(failed: NDArray[np.float64], good: NDArray[np.float64]) -> float | None:
    """Return the probability that a failing draw's value is on the failures' side of a good one's.

    It is the area under the ROC curve (Mann and Whitney 1947), of either sign.
    """
    if min(len(failed), len(good)) < LEAST_FAILED:
        return None
    ranks = rankdata(np.concatenate([failed, good]))[: len(failed)]
    area = (ranks.sum() - len(failed) * (len(failed) + 1) / 2) / (len(failed) * len(good))
    return float(max(area, 1.0 - area))


def _good(rows: Columns) -> Columns:
    return taken(rows, np.flatnonzero(np.isin(rows["verdict"].astype(str), GOOD)))


@dataclass(frozen=True, slots=True)
class Prediction:
    """A linear margin and the failures: median of the margin in failing and good draws."""

    name: str
    failed: float
    good: float
    separates: float | None


def predictions(plan: CampaignPlan, summary: Summary) -> list[Prediction]:
    """Return how well each linear margin of the drawn vehicles separates failures from good draws.

    The margins are those of the frozen controller on each vehicle at its own speed, driving
    straight, at the longest delay of its bus. Empty with few failures, or for a vehicle without a
    linear model.
    """
    sides = [_some(summary.failed), _some(_good(summary.sample))]
    if min(map(len, sides)) < LEAST_FAILED:
        return []
    try:
        failed, good = (np.array([_margins(plan, draw) for draw in draws]) for draws in sides)
    except CanrollError:
        return []
    return [
        Prediction(
            name,
            float(np.median(failed[:, i])),
            float(np.median(good[:, i])),
            separation(failed[:, i], good[:, i]),
        )
        for i, name in enumerate(MARGINS)
    ]


def _some(rows: Columns) -> Sequence[int]:
    return [int(draw) for draw in rows["draw"][:MARGIN_DRAWS]] if count_of(rows) else []


CAP = 60.0
"""A margin of infinity, dB: any gain is stable."""


def _margins(plan: CampaignPlan, draw: int) -> tuple[float, float, float]:
    """Return gain, phase and modulus margin of a draw."""
    settings = plan.draw(draw)
    delay = delay_of(settings)
    task = Task(
        vehicle=settings.vehicle, delay=delay, tick=settings.tick, actuator=settings.actuator
    )
    condition = Condition("laden", settings.speed)
    members = family(task.vehicle, delay, tick=task.tick, lag=task.lag, conditions=(condition,))
    margins = members.margins(dequantise(plan.controller.record)).rows[-1].margins
    gain = margins.gain_db if isfinite(margins.gain_db) else CAP
    phase = margins.phase_deg if isfinite(margins.phase_deg) else 180.0
    return gain, phase, margins.modulus
