"""Multipliers of a level claim: the mean-square gain from a held roll moment to the roll angle.

For given multipliers the least level is that of the bounded real lemma: with the moment apart, M₁
from all other scaled inputs and m from the moment, γ² = max over frequency of
m*(1 + M₁(1 − M₁*M₁)⁻¹M₁*)m. The multipliers of the delays and of what the trigger withholds are
searched for the least γ (Packard and Doyle 1993); roundings get multipliers so large that they
hardly matter.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from gain_gen.certificate.lyapunov import ROOM, LyapunovPoint, UncertainLoop, responses, solved
from gain_gen.models.roll import Matrix, stationary_covariance

TRIED = ((0.02, 100.0), (1e-3, 1e3))
"""1 − decay, relative to that of the loop with the middle delays, and the multiplier of a rounding,
relative to the square of its gain to the roll angle."""
RAISED = (1.003, 1.01, 1.03, 1.1, 1.3)
"""Factors on the least γ² of the grid that are tried."""


def level_points(loop: UncertainLoop) -> Iterator[LyapunovPoint]:
    """Yield points for the least levels; the last input is the moment, its multiplier γ²."""
    gap = 1.0 - loop.radius**2
    if gap > 0.0:
        for part, apart in TRIED:
            yield from _points(loop, 1.0 - part * gap, apart)


def _points(loop: UncertainLoop, decay: float, apart: float) -> Iterator[LyapunovPoint]:
    n, inputs = len(loop.a), loop.inputs.shape[1]
    outputs = np.vstack([loop.jumps, loop.sent, np.r_[loop.roll, np.zeros(inputs)]])
    driven = np.hstack([loop.inputs, *loop.places])
    gains = responses(loop.a, driven, outputs[:, :n])
    gains[:, :, :inputs] += outputs[:, n:]
    of = np.array([j for j, g in enumerate(loop.places) for _ in g.T], dtype=int)
    peak = np.abs(gains).max(axis=0)
    moment, roll = inputs - 1, len(outputs) - 1
    fixed = apart * inputs * np.maximum(peak[roll, :inputs], 1e-9 * peak[roll, :moment].max()) ** 2
    # what an uncertainty adds through the roll angle, and what the moment makes of it
    start = [
        peak[roll, inputs + np.flatnonzero(of == j)].max() * peak[roll, moment] / peak[j, moment]
        for j in range(len(loop.places))
    ]
    if loop.share:
        reach = np.sqrt(loop.share) * peak[roll - 1, moment]
        start.append(peak[roll, 0] * peak[roll, moment] / reach)

    def weights_of(logarithms: Matrix) -> tuple[Matrix, Matrix]:
        free = np.exp(logarithms)
        weights = fixed.copy()
        if loop.share:
            weights[0] = free[-1]
        return free[: len(loop.places)], weights

    def squared(logarithms: Matrix) -> float:
        delays, weights = weights_of(logarithms)
        left = np.sqrt(np.r_[ROOM * delays, weights[0] * loop.share, 1.0])
        right = np.sqrt(np.r_[weights, delays[of]])
        right[moment] = 1.0
        scaled = left[:, None] * gains / right
        m, others = scaled[:, :, moment], np.delete(scaled, moment, axis=2)
        inner = np.eye(len(outputs)) - others @ others.conj().transpose(0, 2, 1)
        lacking = 1e-6 - float(np.linalg.eigvalsh(inner).min())
        if lacking > 0.0:  # no level for these multipliers: towards those that have one
            return 1e6 * float(peak[roll, moment] ** 2) * (1.0 + lacking)
        return float(
            np.einsum("fi,fi->f", m.conj(), np.linalg.solve(inner, m[..., None])[..., 0]).real.max()
        )

    free = np.log(np.array(start))
    if len(free):
        free = minimize(squared, free, method="Nelder-Mead", options={"maxiter": 300}).x
    least = squared(free)
    delays, weights = weights_of(free)
    sizes = _sizes(loop)
    for factor in RAISED:
        weights = weights.copy()
        weights[moment] = factor * least
        point = solved(loop, decay, delays, weights, sizes, performance=1.0)
        if point is not None:
            yield replace(point, roll=float(np.sqrt(weights[moment])))


def _sizes(loop: UncertainLoop) -> Matrix:
    """Return typical sizes of the states under a white moment."""
    moment = loop.inputs[:, -1]
    sizes = np.sqrt(np.diag(stationary_covariance(loop.a, np.outer(moment, moment))))
    return np.asarray(np.where(sizes > 0.0, sizes, 1.0))
