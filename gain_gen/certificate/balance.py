"""Multipliers of the uncertain inputs, relative to each other, that leave the least gain.

Constant scales D of the structured gain (Packard and Doyle 1993) on a grid of frequencies, and κ of
the trigger: where the gain around all of them is less than one, a Lyapunov matrix exists.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from gain_gen.certificate.responses import Responses
from gain_gen.certificate.uncertain_loop import UncertainLoop
from gain_gen.models.roll import Matrix

KAPPA = -1.0
"""At which the search starts: near the best of all laws and buses tried."""
ITERATIONS = 300
NONE = 1e-6
"""Gain that counts as none, relative to the greatest."""


@dataclass(frozen=True, slots=True)
class Balance:
    """Relative multipliers of the uncertain inputs.

    Attributes:
        scales: multiplier of each, relative to that of the first.
        kappa: of the trigger; zero without one.
        gain: greatest around all uncertain inputs with them.
    """

    scales: Matrix
    kappa: float
    gain: float


def balanced(loop: UncertainLoop) -> Balance:
    """Return the balance of least gain of a loop with one or more uncertain inputs."""
    trigger, responses = loop.trigger, Responses(loop)
    start = np.log(_equal(responses))
    if trigger is not None:
        start = np.r_[start, np.log(trigger.curvature(KAPPA))]

    def balance(free: Matrix) -> Balance:
        kappa = 0.0
        if trigger is not None:
            kappa, free = trigger.kappa(float(np.exp(free[-1]))), free[:-1]
        scales = np.exp(np.r_[0.0, free])
        return Balance(scales, kappa, _gain(responses, scales, kappa))

    def gain(free: Matrix) -> float:
        return balance(free).gain

    if not len(start):  # of a single one there is nothing to balance
        return balance(start)
    return balance(
        np.asarray(minimize(gain, start, method="Nelder-Mead", options={"maxiter": ITERATIONS}).x)
    )


def _gain(responses: Responses, scales: Matrix, kappa: float) -> float:
    """Return the greatest gain around all uncertain inputs, scaled."""
    of = responses.columns
    gains = responses.centred(kappa)[:, :-1, of >= 0]
    roots = np.sqrt(scales)
    scaled = roots[responses.rows][:, None] * gains / roots[of[of >= 0]]
    return float(np.sqrt(np.linalg.eigvalsh(scaled @ scaled.conj().swapaxes(1, 2)).max()))


def _equal(responses: Responses) -> Matrix:
    """Return scales with which each has the same gain to the first as the first has to it."""
    peak = np.abs(responses.centred(KAPPA)[:, :-1]).max(axis=0)
    rows, columns = responses.rows, responses.columns
    others = range(1, int(columns.max()) + 1)
    to = np.array([peak[rows == 0][:, columns == j].max() for j in others])
    back = np.array([peak[rows == j][:, columns == 0].max() for j in others])
    none = max(NONE * float(peak.max()), float(np.finfo(float).tiny))
    return np.asarray(np.maximum(to, none) / np.maximum(back, none))
