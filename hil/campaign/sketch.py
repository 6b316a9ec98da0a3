"""Quantiles of any number of values in a fixed memory."""

from math import log

import numpy as np
from numpy.typing import NDArray

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
        found = np.clip(middles, self.low, self.high)
        found[shares <= 0.0], found[shares >= 1.0] = self.low, self.high
        return np.asarray(found, dtype=np.float64)
