"""A slowly changing signal without its noise: a smoothing spline of samples at equal intervals.

The least sum of squared differences from the samples and of λ times the squared second differences
(Whittaker), with the λ of least generalised cross-validation (Craven and Wahba, 1979). A signal
without noise stays as it is.
"""

from dataclasses import dataclass, field
from math import exp, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.optimize import minimize_scalar

from canroll.typing import Vector

LEAST, MOST = -5.0, 25.0
"""Bounds of ln λ: from the samples themselves to a straight line of an hour."""
SECOND_DIFFERENCE = (1.0, -2.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """White noise of a signal's samples, and the λ with which it was smoothed, 0 if it was not.

    ``deviation`` is the samples' standard deviation, in the signal's unit, ``times`` (s) is when
    they were taken: between two of them a signal is interpolated, and the noise of it is smaller.
    """

    deviation: float = 0.0
    weight: float = 0.0
    times: Vector = field(default_factory=lambda: np.zeros(0))

    def errors(self, times: Vector, generator: np.random.Generator) -> Vector:
        """Return a draw of the errors that the signal has at ``times`` (s), (n,).

        The covariance at the samples is σ² (I + λ DᵀD)⁻¹, which also covers, on average over the
        time, what smoothing takes from the signal itself (Wahba, J. R. Statist. Soc. B 45, 1983).
        """
        count = len(self.times)
        if not count:
            return np.zeros(len(times))
        bent = sqrt(self.weight) * generator.standard_normal(count - 2)
        drawn = generator.standard_normal(count)
        for place, weight in enumerate(SECOND_DIFFERENCE):
            drawn[place : count - 2 + place] += weight * bent
        errors = self.deviation * _solved(self.weight, _roughness(count), drawn)
        return np.asarray(np.interp(times, self.times, errors))


EXACT = Noise()


def smoothed(times: Vector, samples: Vector) -> tuple[Vector, Noise]:
    """Return the signal of ``samples`` (n), n ≥ 5, at ``times`` (s), and its noise.

    The times are stamps of samples taken at equal intervals.
    """
    bands = _roughness(len(samples))
    # eigenvalues of the matrix of roughness, but for its ends
    turns = np.pi * np.arange(len(samples)) / len(samples)
    rough = (2.0 - 2.0 * np.cos(turns)) ** 2

    def removed(weight: float) -> tuple[float, float]:
        """Sum of squares that goes, and how many samples' noise that is."""
        squares = np.sum((samples - _solved(weight, bands, samples)) ** 2)
        return float(squares), float(np.sum(1.0 - 1.0 / (1.0 + weight * rough)))

    def score(exponent: float) -> float:
        squares, count = removed(exp(exponent))
        return squares / count**2

    weight = exp(minimize_scalar(score, bounds=(LEAST, MOST), method="bounded").x)
    squares, count = removed(weight)
    return _solved(weight, bands, samples), Noise(sqrt(squares / count), weight, times)


def _solved(weight: float, bands: NDArray[np.float64], right: Vector) -> Vector:
    """Return (I + ``weight`` DᵀD)⁻¹ times ``right``."""
    matrix = weight * bands
    matrix[2] += 1.0
    return np.asarray(solveh_banded(matrix, right))


def _roughness(count: int) -> NDArray[np.float64]:
    """Return DᵀD of the second differences D as upper bands, (3, count)."""
    bands = np.zeros((3, count))
    for place, weight in enumerate(SECOND_DIFFERENCE):
        bands[2, place : count - 2 + place] += weight**2
    bands[1, 1 : count - 1] -= 2.0
    bands[1, 2:] -= 2.0
    bands[0, 2:] = 1.0
    return bands
