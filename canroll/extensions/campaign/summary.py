"""What a campaign's page and JSON object need of its draws, in a fixed memory."""

from dataclasses import dataclass, field
from math import log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.extensions.campaign.events import EVENTS
from canroll.extensions.campaign.intervals import Interval, always, exact
from canroll.extensions.campaign.plan import GOOD, SIDES, VERDICTS, Columns

QUANTITIES = ("roll_max_deg", "roll_rms_deg", "nlt_front_max", "moment_rms_nm", "path_error_max_m")
QUANTILES = (5, 50, 95)
SAMPLE = 10_000
"""Draws, the first ones, that sensitivities are estimated from."""
REDUCTION = "reduction"
WORST = 50
"""Hardest draws that are kept whole."""
FAILED = 1000
"""Failing draws, the first ones, that are kept whole."""
ACCURACY = 1e-3
"""Relative error of a quantile."""
LEAST = 1e-6
"""Smaller values count as 0."""
MOST = 1e9
GAMMA = (1.0 + ACCURACY) / (1.0 - ACCURACY)
BINS = round(log(MOST / LEAST) / log(GAMMA)) + 1


class Sketch:
    """Counts of non-negative values in bins of equal ratio (DDSketch, Masson et al., VLDB 2019).

    The order in which values are added makes no difference. Quantiles have a relative error of
    0.1 %, the least and the largest value are exact.
    """

    def __init__(self) -> None:
        self.counts: NDArray[np.int64] = np.zeros(BINS + 1, dtype=np.int64)
        self.low, self.high = np.inf, -np.inf

    def add(self, values: NDArray[np.float64]) -> None:
        """Add values."""
        if not len(values):
            return
        self.low, self.high = min(self.low, values.min()), max(self.high, values.max())
        scaled = np.maximum(values, LEAST) / LEAST
        bins = np.clip(np.ceil(np.log(scaled) / log(GAMMA)), 0, BINS).astype(np.int64)
        self.counts += np.bincount(bins, minlength=BINS + 1)

    def quantiles(self, shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values that ``shares`` (0 to 1) of all values do not exceed."""
        total = np.cumsum(self.counts)
        ranks = shares * (total[-1] - 1)
        bins = np.searchsorted(total, ranks, side="right")
        middles = np.where(bins == 0, 0.0, 2.0 * LEAST * GAMMA**bins / (GAMMA + 1.0))
        values = np.clip(middles, self.low, self.high)
        values[shares <= 0.0], values[shares >= 1.0] = self.low, self.high
        return np.asarray(values, dtype=np.float64)


@dataclass
class Summary:
    """What is kept of the draws added so far, in the order of their numbers.

    Attributes:
        draws: how many.
        verdicts: counts by verdict.
        events: counts by event.
        worst_by: what the hardest draws go by: :data:`REDUCTION` or a metric with control.
        worst: rows of the hardest draws, see :func:`hardest`.
        sample: rows of the first draws.
        failed: rows of the first draws that fail.
    """

    worst_by: str = REDUCTION
    draws: int = 0
    verdicts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(VERDICTS, 0))
    events: dict[str, int] = field(default_factory=lambda: dict.fromkeys(EVENTS, 0))
    worst: Columns = field(default_factory=dict)
    sample: Columns = field(default_factory=dict)
    failed: Columns = field(default_factory=dict)
    sketches: dict[tuple[str, str], Sketch] = field(
        default_factory=lambda: {(name, side): Sketch() for name in QUANTITIES for side in SIDES}
    )

    def add(self, rows: Columns) -> None:
        """Add the next rows of the table."""
        count = len(rows["draw"])
        self.draws += count
        for verdict in VERDICTS:
            self.verdicts[verdict] += int(np.sum(rows["verdict"] == verdict))
        for name, event in EVENTS.items():
            self.events[name] += int(np.sum(event.occurs(rows)))
        for (name, side), sketch in self.sketches.items():
            sketch.add(rows[f"{side}_{name}"])
        if self.draws - count < SAMPLE:
            self.sample = first(joined(self.sample, rows), SAMPLE)
        fails = EVENTS["fails"].occurs(rows)
        if fails.any() and count_of(self.failed) < FAILED:
            self.failed = first(joined(self.failed, taken(rows, np.flatnonzero(fails))), FAILED)
        self.worst = hardest(joined(self.worst, rows), self.worst_by)

    @property
    def fails(self) -> int:
        """Number of draws in which control fails."""
        return self.events["fails"]

    def interval(self, event: str) -> Interval:
        """Return the exact interval of an event's probability for the number of draws."""
        return exact(self.events[event], self.draws)

    def sequence(self, event: str) -> Interval:
        """Return the interval that is valid at every number of draws."""
        return always(self.events[event], self.draws)

    def quantiles(self) -> dict[str, dict[str, dict[str, float]]]:
        """Return least, 5 %, 50 %, 95 % and largest of each figure, without and with control."""
        by_quantity: dict[str, dict[str, dict[str, float]]] = {name: {} for name in QUANTITIES}
        shares = np.array([0.0, *(q / 100 for q in QUANTILES), 1.0])
        keys = ("min", *(f"p{q}" for q in QUANTILES), "max")
        for (name, side), sketch in self.sketches.items():
            values = map(float, sketch.quantiles(shares))
            by_quantity[name][side] = dict(zip(keys, values, strict=True))
        return by_quantity


def count_of(rows: Columns) -> int:
    """Return the number of rows."""
    return len(rows["draw"]) if rows else 0


def joined(rows: Columns, more: Columns) -> Columns:
    """Return the rows followed by ``more``."""
    return {name: np.concatenate([rows[name], more[name]]) for name in rows} if rows else more


def taken(rows: Columns, which: NDArray[np.int64]) -> Columns:
    """Return the rows ``which``."""
    return {name: column[which] for name, column in rows.items()}


def first(rows: Columns, count: int) -> Columns:
    """Return the first ``count`` rows."""
    return {name: column[:count] for name, column in rows.items()}


def reduction(rows: Columns) -> NDArray[np.float64]:
    """Return the reduction of the largest roll angle by control of each row, as a fraction."""
    before, after = (rows[f"{side}_roll_max_deg"] for side in SIDES)
    return 1.0 - np.divide(after, before, out=np.ones_like(after), where=before > 0.0)


def hardest(rows: Columns, by: str) -> Columns:
    """Return the hardest rows: failures first, then by least reduction or largest metric."""
    good = np.isin(rows["verdict"].astype(str), GOOD)
    ease = reduction(rows) if by == REDUCTION else -np.abs(rows[f"{SIDES[1]}_{by}"])
    return taken(rows, np.lexsort((rows["draw"], ease, good))[:WORST])


def order(by: str) -> str:
    """Return in words how the hardest draws are ordered."""
    what = "least reduction of the roll angle" if by == REDUCTION else f"largest {by}"
    return f"failures first, then by {what}"


def plain(rows: Columns, index: int) -> dict[str, Any]:
    """Return a row as plain data."""
    cells = {name: column[index] for name, column in rows.items()}
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in cells.items()}
