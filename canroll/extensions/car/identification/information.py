"""What a log tells: Fisher information beside the priors, covariance, and what stays a guess.

All in coordinates of the unknowns, of which the priors are standard normal and independent.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canroll.extensions.car.identification.colour import misfit_covariance, score_covariance
from canroll.extensions.car.identification.input_noise import input_scores
from canroll.extensions.car.identification.output_error import Point, Simulator
from canroll.extensions.car.identification.unknowns import FittedNumber, Unknown
from canroll.typing import Vector

IDENTIFIED = 0.5
"""Share of its prior variance that an unknown told by a log keeps at most: of one with more the log
says less than was known before."""
AT = 1e-3
"""Distance from a bound, share of the range, within which a number stands at it."""
TINY = 1e-12
"""Share of the whole information that a direction without any is given, to be divided by."""
TOGETHER = 0.9
"""Correlation beyond which two unknowns are identifiable only together."""


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """Information of a log at a point of a model.

    Attributes:
        fisher: of the signals alone (p, p): JᵀW J.
        scores: covariance (p, p) of JᵀW times the noise, as coloured as the residuals are.
        misfit: of JᵀW times the misfit of the model; None without any.
        of_inputs: whether the noise of the inputs is in it: not, where none could be driven.
    """

    fisher: NDArray[np.float64]
    scores: NDArray[np.float64]
    misfit: NDArray[np.float64] | None = None
    of_inputs: bool = True

    @property
    def directions(self) -> int:
        """Number of combinations of the unknowns of which the log says more than the priors."""
        return int(np.sum(np.linalg.eigvalsh(self.fisher) > 1.0))

    def covariance(self, free: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the covariance (p, p) of all unknowns where only the ``free`` ones were fitted.

        Those held are as uncertain as before, and make the fitted ones uncertain: Bierman,
        Factorization Methods for Discrete Sequential Estimation, VIII ("consider" parameters).
        A misfit makes them at most as uncertain as before.
        """
        size = len(self.fisher)
        inverse = np.linalg.inv(self.fisher[np.ix_(free, free)] + np.eye(int(free.sum())))
        noise = self.scores[np.ix_(free, free)] + np.eye(int(free.sum()))
        through = -inverse @ self.fisher[np.ix_(free, ~free)]
        own = inverse @ noise @ inverse
        if self.misfit is not None and self.misfit.any():
            sizes, axes = np.linalg.eigh(own + inverse @ self.misfit[np.ix_(free, free)] @ inverse)
            own = at_least((axes * np.minimum(sizes, 1.0)) @ axes.T, own)
        result = np.eye(size)
        result[np.ix_(free, free)] = own + through @ through.T
        result[np.ix_(free, ~free)] = through
        result[np.ix_(~free, free)] = through.T
        return result

    def least(self, free: NDArray[np.bool_]) -> Vector:
        """Return the least standard deviations of the fitted unknowns, 1 of the held (p).

        That is the Cramér–Rao bound with priors, were the residuals noise of the model's weights.
        """
        result = np.ones(len(self.fisher))
        inverse = np.linalg.inv(self.fisher[np.ix_(free, free)] + np.eye(int(free.sum())))
        result[free] = np.sqrt(np.diag(inverse))
        return result


def fisher_at(simulator: Simulator, point: Point) -> NDArray[np.float64]:
    """Return JᵀW J of the signals at a point of a search (p, p)."""
    return _products(simulator.slopes(point.x) / point.scale[:, None])


def felt(fisher: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which unknowns a log says more of than the prior, were all others known (p).

    The others cannot be told by it at all.
    """
    return np.asarray(np.diag(fisher) > 1.0)


def information(
    simulator: Simulator, point: Point, report: Callable[[float], None] = lambda share: None
) -> Information:
    """Return the information at a point at which a search has ended.

    ``report`` is called with the share of the drives with other inputs that is done.
    """
    x, compared = point.x, simulator.model.compared
    errors, simulated = simulator.residuals(x), simulator.signals(x)
    assert simulated is not None  # the search has ended there
    scaled = simulator.slopes(x) / point.scale[:, None]
    weighted = scaled / point.scale[:, None]
    scores = score_covariance(weighted, errors, compared)
    effect = input_scores(simulator, x, simulated, weighted, report)
    # what the inputs' errors make of the residuals is no noise of the signals
    squares = np.maximum((errors**2).sum(axis=0), TINY)
    share = np.maximum(1.0 - effect.variances * compared.sum(axis=0) / squares, 0.0)
    white = _products(scaled * np.sqrt(share)[:, None])
    scores = at_least(scores, white + effect.covariance)
    misfit = misfit_covariance(weighted, errors, compared)
    return Information(
        fisher_at(simulator, point), scores, misfit=misfit, of_inputs=effect.drives > 0
    )


def _products(scaled: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return JᵀJ of derivatives (n, m, p)."""
    flat = scaled.reshape(-1, scaled.shape[2])
    return np.asarray(flat.T @ flat)


def at_least(scores: NDArray[np.float64], least: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return scores that in no direction are less than those of noise that is known to be there.

    That is white noise of the signals and the effect of the inputs' errors. A fit takes out of the
    residuals what its numbers can follow: there they are too small.
    """
    values, vectors = np.linalg.eigh(least + TINY * np.trace(least) * np.eye(len(least)))
    root = vectors * np.sqrt(values)
    back = vectors / np.sqrt(values)
    sizes, axes = np.linalg.eigh(back.T @ scores @ back)
    turned = root @ axes
    return np.asarray((turned * np.maximum(sizes, 1.0)) @ turned.T)


def numbers_at(
    sought: Sequence[Unknown],
    x: Vector,
    covariance: NDArray[np.float64],
    free: NDArray[np.bool_],
) -> tuple[FittedNumber, ...]:
    """Return the numbers at coordinates ``x`` with their covariance; those not free are kept."""
    numbers = []
    for i, unknown in enumerate(sought):
        state = "identified" if covariance[i, i] < IDENTIFIED else "together"
        value = unknown.value(float(x[i]))
        if min(value - unknown.least, unknown.most - value) < AT * (unknown.most - unknown.least):
            state = "bound"
        deviation = unknown.slope(value) * float(np.sqrt(covariance[i, i]))
        numbers.append(FittedNumber(unknown, value, deviation, state if free[i] else "kept"))
    return tuple(numbers)


def together(
    covariance: NDArray[np.float64], labels: Sequence[str], count: int = 3
) -> list[tuple[str, str, float]]:
    """Return the pairs of unknowns that are identifiable only together, the strongest first."""
    deviations = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviations, deviations)
    pairs = [
        (labels[i], labels[j], float(correlation[i, j]))
        for i in range(len(labels))
        for j in range(i + 1, len(labels))
        if abs(correlation[i, j]) > TOGETHER
    ]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))[:count]
