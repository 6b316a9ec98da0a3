"""How well a simulated drive agrees with a measured one, and what the residuals still contain."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canroll.extensions.car.identification.pieces import SAMPLE
from canroll.typing import Vector

LAGS = 100
"""Lags of the tests (1 s)."""
NORMAL = 2.58
"""Bound that a standard normal number exceeds once in a hundred times."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """One signal, simulated against measured.

    Attributes:
        name: of the signal.
        explained: variance accounted for, 1 − var(difference)/var(measured).
        rms: of the difference, SI units.
        correlated: time over which the difference is correlated (s), 0 if it is white.
        white: whether no more lags than chance would have it are correlated.
        driven: largest correlation of the difference with the steering before it, in bounds that
            chance exceeds once in a hundred times; above 1 the model misses what steering causes.
    """

    name: str
    explained: float
    rms: float
    correlated: float
    white: bool
    driven: float


def agreement(
    name: str,
    measured: Vector,
    simulated: Vector,
    steering: Vector,
    compared: NDArray[np.bool_],
) -> Agreement:
    """Judge a signal where it is ``compared``; all shapes (n,)."""
    there = measured[compared]
    difference = np.where(compared, simulated - measured, 0.0)
    inside = difference[compared]
    variance = float(np.var(there))
    explained = 1.0 - float(np.var(inside)) / variance if variance > 0 else float("nan")
    own, white = autocorrelation(difference, compared)
    below = np.flatnonzero(np.abs(own) < np.exp(-1.0))
    time = 0.0 if white else SAMPLE * float(below[0] if below.size else own.size)
    rms = float(np.sqrt(np.mean(inside**2)))
    return Agreement(
        name, explained, rms, time, white, _driven(difference, steering, compared, own)
    )


def autocorrelation(errors: Vector, compared: NDArray[np.bool_]) -> tuple[Vector, bool]:
    """Return the correlations of residuals (n,) at lags from 0 on, and whether they are white."""
    own = _correlations(errors, errors, compared)
    outside = np.abs(own[1:]) > NORMAL / np.sqrt(max(compared.sum(), 1))
    # chance has 1 in 100 outside, and more than 4 of a hundred once in 300 signals
    return own, bool(outside.sum() <= max(0.04 * outside.size, 1))


def _correlations(a: Vector, b: Vector, compared: NDArray[np.bool_]) -> Vector:
    """Return the correlations of a(t + lag) with b(t) at lags from 0 on."""
    a, b = (np.where(compared, x - x[compared].mean(), 0.0) for x in (a, b))
    scale = np.sqrt(np.sum(a**2) * np.sum(b**2))
    most = min(LAGS, len(a) // 4)
    if not scale > 0.0:
        return np.concatenate(([1.0], np.zeros(most)))
    return np.array([float(a[lag:] @ b[: len(b) - lag]) / scale for lag in range(most + 1)])


def _driven(
    difference: Vector, steering: Vector, compared: NDArray[np.bool_], own: Vector
) -> float:
    """Largest cross-correlation in its bound for two independent coloured signals (Bartlett)."""
    cross = _correlations(difference, steering, compared)
    driver = _correlations(steering, steering, compared)
    variance = (1.0 + 2.0 * float(own[1:] @ driver[1:])) / max(compared.sum(), 1)
    bound = NORMAL * np.sqrt(max(variance, 1.0 / max(compared.sum(), 1)))
    return float(np.abs(cross).max() / bound)
