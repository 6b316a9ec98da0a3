"""What noise of the measured steering and speed, which the simulated car follows, does to a fit.

Output error takes the inputs as exact. Their errors n move the simulated signals by H n, H being
the car's response to its inputs, and that is in the residuals of the best fit as well, in all
signals together and for as long as the car responds. The fit's scores Jᵀ W (noise) have from it
the covariance Jᵀ W H Σ Hᵀ W J, with Σ that of the inputs' errors: errors in variables to first
order (Fuller, Measurement Error Models, 1987, 3.1). It is the mean over draws of n, each driven.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from canroll.identification.output_error import Model
from canroll.typing import Vector

DRAWS = 50
"""Drives with other inputs: deviations are known to 10 %, the root of 1/(2 · 50)."""
SEED = 1


def effects(
    model: Model, x: Vector, simulated: NDArray[np.float64]
) -> Iterator[NDArray[np.float64]]:
    """Yield what draws of the inputs' errors do to the signals, (n, m), 0 where not compared.

    Args:
        model: with the pieces of the log.
        x: coordinates of the unknowns.
        simulated: signals there, (n, m), with the inputs as they were measured.
    """
    generator, compared = np.random.default_rng(SEED), model.compared
    for _ in range(DRAWS):
        pieces = tuple(piece.disturbed(generator) for piece in model.pieces)
        other = replace(model, pieces=pieces).simulated(x)
        if other is not None:
            yield np.where(compared, other - simulated, 0.0)


def input_scores(
    model: Model, x: Vector, simulated: NDArray[np.float64], weighted: NDArray[np.float64]
) -> tuple[NDArray[np.float64], Vector]:
    """Return the covariance of the scores by the inputs' errors, and the signals' variances by it.

    Args:
        model: with the pieces of the log.
        x: coordinates of the unknowns.
        simulated: signals there, (n, m).
        weighted: derivatives over the squared scale, (n, m, p), 0 where nothing is compared.

    Returns:
        shapes (p, p) and (m,); zero where no draw could be driven.
    """
    size, signals = weighted.shape[2], weighted.shape[1]
    covariance, squares, drives = np.zeros((size, size)), np.zeros(signals), 0
    for effect in effects(model, x, simulated):
        score = np.einsum("nmp,nm->p", weighted, effect)
        covariance += np.outer(score, score)
        squares += (effect**2).sum(axis=0)
        drives += 1
    counts = np.maximum(model.compared.sum(axis=0), 1)
    return covariance / max(drives, 1), squares / counts / max(drives, 1)
