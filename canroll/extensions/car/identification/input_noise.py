"""What noise of the measured steering and speed, which the simulated car follows, does to a fit.

Output error takes the inputs as exact. Their errors n move the simulated signals by H n, H being
the car's response to its inputs, and that is in the residuals of the best fit as well, in all
signals together and for as long as the car responds. The fit's scores Jᵀ W (noise) have from it
the covariance Jᵀ W H Σ Hᵀ W J, with Σ that of the inputs' errors: errors in variables to first
order (Fuller, Measurement Error Models, 1987, 3.1). It is the mean over draws of n, each driven.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.extensions.car.identification.output_error import Simulator
from canroll.typing import Vector

DRAWS = 50
"""Drives with other inputs: deviations are known to 10 %, the root of 1/(2 · 50)."""
SEED = 1


class InputEffect(NamedTuple):
    """What the inputs' errors do, over ``drives`` draws that could be driven; zero without any.

    ``covariance`` (p, p) is that of the scores, ``variances`` (m) are those of the signals.
    """

    covariance: NDArray[np.float64]
    variances: Vector
    drives: int


def effects(
    simulator: Simulator, x: Vector, simulated: NDArray[np.float64]
) -> Iterator[NDArray[np.float64]]:
    """Yield what draws of the inputs' errors do to the signals, (n, m), 0 where not compared.

    Draws that cannot be driven are left out.

    Args:
        simulator: of a model with the pieces of the log.
        x: coordinates of the unknowns.
        simulated: signals there, (n, m), with the inputs as they were measured.
    """
    model, generator = simulator.model, np.random.default_rng(SEED)
    draws = (tuple(piece.disturbed(generator) for piece in model.pieces) for _ in range(DRAWS))
    compared = model.compared
    for other in simulator.of_inputs(x, draws):
        if other is not None:
            yield np.where(compared, other - simulated, 0.0)


def input_scores(
    simulator: Simulator,
    x: Vector,
    simulated: NDArray[np.float64],
    weighted: NDArray[np.float64],
    report: Callable[[float], None],
) -> InputEffect:
    """Return the effect of the inputs' errors on the scores and on the signals.

    Args:
        simulator: of a model with the pieces of the log.
        x: coordinates of the unknowns.
        simulated: signals there, (n, m).
        weighted: derivatives over the squared scale, (n, m, p), 0 where nothing is compared.
        report: called with the share of the drives that is done.
    """
    size, signals = weighted.shape[2], weighted.shape[1]
    covariance, squares, drives = np.zeros((size, size)), np.zeros(signals), 0
    for effect in effects(simulator, x, simulated):
        score = np.einsum("nmp,nm->p", weighted, effect)
        covariance += np.outer(score, score)
        squares += (effect**2).sum(axis=0)
        drives += 1
        report(drives / DRAWS)
    counts = np.maximum(simulator.model.compared.sum(axis=0), 1)
    return InputEffect(covariance / max(drives, 1), squares / counts / max(drives, 1), drives)
