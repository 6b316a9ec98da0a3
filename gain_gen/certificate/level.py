"""Multipliers of a level claim: the mean-square gain from a held roll moment to the roll angle.

For given multipliers the least level is that of the bounded real lemma: with the moment apart, M₁
from all other scaled inputs and m from the moment, γ² = max over frequency of
m*(1 + M₁(1 − M₁*M₁)⁻¹M₁*)m. The multipliers of the delays and of what the trigger withholds are
searched for the least γ (Packard and Doyle 1993). A rounding, at most ν, with the gain g to the
roll angle and the multiplier m raises γ² by a part of g²/m and the level of the ellipsoid, in which
no stored value may saturate, by m ν². For a given raise the level is least with m as g/ν.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import minimize

from gain_gen.certificate.balance import KAPPA, Balance, balanced
from gain_gen.certificate.lyapunov import GRANTED, LyapunovPoint, fits, solved, uncentred
from gain_gen.certificate.responses import Responses
from gain_gen.certificate.uncertain_loop import UncertainLoop
from gain_gen.models.roll import Matrix, stationary_covariance

PARTS = (0.1, 0.02, 0.005, 1e-3)
"""Tried 1 − decay, relative to that of the loop with the middle delays."""
APART = 1e3
"""Inverse of the part of γ² by which all roundings raise it on their way to the roll angle."""
RAISED = (1.003, 1.01, 1.03, 1.06, 1.1, 1.2, 1.4)
"""Factors on the least γ² of the grid that are tried."""
CLEAR = 1.03
"""Factor on the energy of what is uncertain, so that the least γ² lies within what is feasible."""
ITERATIONS = 600


def level_points(loop: UncertainLoop) -> Iterator[LyapunovPoint]:
    """Yield points for the least levels; the last input is the moment, its multiplier γ²."""
    if loop.radius >= 1.0:
        return
    search, free = _Search(loop), np.zeros(0)
    if loop.trigger or loop.places:
        start: Any = search.start(balanced(loop))
        free = minimize(
            search.squared, start, method="Nelder-Mead", options={"maxiter": ITERATIONS}
        ).x
    least, kappa = search.squared(free), search.kappa(free)
    centred = loop.centred(kappa)
    gap = 1.0 - centred.radius**2
    delays, weights = search.multipliers(free)
    for factor, part in product(RAISED, PARTS if gap > 0.0 else ()):
        weights = np.r_[weights[:-1], factor * least]
        sizes, decay = _sizes(centred), 1.0 - part * gap
        point = solved(centred, decay, delays, weights, sizes, performance=1.0)
        if point is not None and fits(centred, point):
            point = replace(point, roll=float(np.sqrt(weights[-1])))
            yield uncentred(point, loop.trigger, kappa) if loop.trigger else point


class _Search:
    """Least γ² over the logarithms of the multipliers of the delays, then of the trigger and c."""

    def __init__(self, loop: UncertainLoop) -> None:
        self._trigger, self._delays = loop.trigger, len(loop.places)
        self._responses, self._inputs = Responses(loop), loop.inputs.shape[1]
        rounded = slice(1 if self._trigger else 0, self._inputs - 1)
        bounds, peak = loop.bounds[rounded], np.abs(self._responses.centred(KAPPA)).max(axis=0)[-1]
        reach = bounds * peak[: self._inputs][rounded]
        self._weights = np.ones(self._inputs)
        granted = np.maximum(reach, GRANTED * reach.sum())
        self._weights[rounded] = APART * granted * granted.sum() / bounds**2

    def kappa(self, free: Matrix) -> float:
        """Return κ of the trigger, zero without one."""
        return self._trigger.kappa(float(np.exp(free[-1]))) if self._trigger else 0.0

    def multipliers(self, free: Matrix) -> tuple[Matrix, Matrix]:
        """Return multipliers of the delays and of the inputs; that of the moment, the last, one."""
        weights = self._weights.copy()
        if self._trigger:
            weights[0] = np.exp(free[-2])
        return np.exp(free[: self._delays]), weights

    def start(self, balance: Balance) -> Matrix:
        """Return the best multipliers of a few that are balanced."""
        free = np.log(balance.scales)
        if self._trigger:
            free = np.r_[free[1:], free[0], np.log(self._trigger.curvature(balance.kappa))]
        balanced = np.arange(len(free)) < len(balance.scales)
        gain = float(np.abs(self._responses.centred(balance.kappa)[:, -1]).max())
        units = gain**2 * np.geomspace(1e-20, 1e6, 53)
        tried = [free + np.log(unit) * balanced for unit in units]
        return min(tried, key=self.squared)

    def squared(self, free: Matrix) -> float:
        """Return the greatest γ² over frequency, or a large number where there is none."""
        delays, weights = self.multipliers(free)
        uncertain = np.r_[weights[:1] if self._trigger else [], delays]
        rows, places = self._responses.rows, self._responses.columns[len(weights) :]
        left = np.sqrt(np.r_[CLEAR * uncertain[rows], 1.0])
        right = np.sqrt(np.r_[weights, uncertain[places]])
        gains = self._responses.centred(self.kappa(free))
        scaled = left[:, None] * gains / right
        moment = len(weights) - 1
        m, others = scaled[:, :, moment], np.delete(scaled, moment, axis=2)
        inner = np.eye(len(left)) - others @ others.conj().swapaxes(1, 2)
        lacking = 1e-6 - float(np.linalg.eigvalsh(inner).min())
        if lacking > 0.0:  # no level for these multipliers: towards those that have one
            return 1e6 * float(np.abs(gains[:, -1, moment]).max() ** 2) * (1.0 + lacking)
        solution = np.linalg.solve(inner, m[..., None])[..., 0]
        return float(np.einsum("fi,fi->f", m.conj(), solution).real.max())


def _sizes(loop: UncertainLoop) -> Matrix:
    """Return typical sizes of the states under a white moment."""
    moment = loop.inputs[:, -1]
    sizes = np.sqrt(np.diag(stationary_covariance(loop.a, np.outer(moment, moment))))
    return np.asarray(np.where(sizes > 0.0, sizes, 1.0))
