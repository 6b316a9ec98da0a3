"""A slowly changing signal without its noise: a smoothing spline on a uniform time base.

The least sum of squared differences from the samples and of λ times the squared second differences
(Whittaker), with the λ of least generalised cross-validation (Craven and Wahba, 1979). A signal
without noise stays as it is.
"""

from math import exp

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.optimize import minimize_scalar

from canroll.typing import Vector

LEAST, MOST = -5.0, 25.0
"""Bounds of ln λ: from the samples themselves to a straight line of an hour."""


def smoothed(samples: Vector) -> Vector:
    """Return the signal of ``samples`` (n), n ≥ 5, at equal intervals."""
    bands = _roughness(len(samples))
    # eigenvalues of the matrix of roughness, but for its ends
    turns = np.pi * np.arange(len(samples)) / len(samples)
    rough = (2.0 - 2.0 * np.cos(turns)) ** 2

    def at(weight: float) -> Vector:
        matrix = weight * bands
        matrix[2] += 1.0
        return np.asarray(solveh_banded(matrix, samples))

    def score(exponent: float) -> float:
        removed = np.sum(1.0 - 1.0 / (1.0 + exp(exponent) * rough))
        return float(np.sum((samples - at(exp(exponent))) ** 2) / removed**2)

    best = minimize_scalar(score, bounds=(LEAST, MOST), method="bounded")
    return at(exp(best.x))


def _roughness(count: int) -> NDArray[np.float64]:
    """Return DᵀD of the second differences D as upper bands, (3, count)."""
    bands = np.zeros((3, count))
    for place, weight in enumerate((1.0, -2.0, 1.0)):
        bands[2, place : count - 2 + place] += weight**2
    bands[1, 1 : count - 1] -= 2.0
    bands[1, 2:] -= 2.0
    bands[0, 2:] = 1.0
    return bands
