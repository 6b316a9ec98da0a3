"""Intervals of a probability: exact for a fixed number of draws, and valid at every number.

Clopper and Pearson (1934): the coverage is at least the confidence for any probability and number
of independent draws. The confidence sequence of :func:`always` covers at all numbers of draws at
once with that confidence, so that a campaign may stop whenever its width suffices: the likelihood
ratio against a Beta mixture is a martingale, which Ville's inequality (1939) bounds (Robbins 1970).
"""

from dataclasses import dataclass
from math import exp, log

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import betainccinv, betaincinv, betaln, xlog1py, xlogy

CONFIDENCE = 0.95
MIXTURE = 0.5
"""Both parameters of the Beta mixture: Jeffreys', whose regret is least at any probability."""
TOLERANCE = 1e-12
LEAST = -700.0
"""Logarithm of the least probability that is tried."""


@dataclass(frozen=True, slots=True)
class Interval:
    """Bounds of a probability."""

    low: float
    high: float

    @property
    def width(self) -> float:
        """Distance of the bounds."""
        return self.high - self.low


def exact(events: int, draws: int, confidence: float = CONFIDENCE) -> Interval:
    """Return the interval of Clopper and Pearson for ``events`` in ``draws``."""
    half = (1.0 - confidence) / 2.0
    low = float(betaincinv(events, draws - events + 1, half)) if events else 0.0
    high = float(betainccinv(events + 1, draws - events, half)) if events < draws else 1.0
    return Interval(low, high)


def always(events: int, draws: int, confidence: float = CONFIDENCE) -> Interval:
    """Return the confidence sequence's interval after ``draws``; it covers at all numbers at once.

    ``events`` and ``draws`` count independent draws in the order of their numbers.
    """
    if not draws:
        return Interval(0.0, 1.0)
    limit = -log(1.0 - confidence)

    def least(count: int) -> float:
        def excess(logarithm: float) -> float:
            return float(martingale(count, draws, exp(logarithm))) - limit

        # by its logarithm: of one event in many draws it is below any step of the probability
        if not count:
            return 0.0
        return exp(brentq(excess, LEAST, log(count / draws), xtol=TOLERANCE))

    return Interval(least(events), 1.0 - least(draws - events))


def martingale(events: ArrayLike, draws: ArrayLike, probability: float) -> NDArray[np.float64]:
    """Return the logarithm of the likelihood ratio of a Beta mixture against ``probability``.

    If that is the probability, the ratio ever exceeds 1/α with a probability of at most α.
    """
    count, rest = np.asarray(events), np.asarray(draws) - np.asarray(events)
    mixed = betaln(MIXTURE + count, MIXTURE + rest) - betaln(MIXTURE, MIXTURE)
    return np.asarray(mixed - xlogy(count, probability) - xlog1py(rest, -probability))
