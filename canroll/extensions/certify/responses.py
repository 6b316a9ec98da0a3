"""Responses of an uncertain loop over frequency, and the multipliers with the least gain around.

Multipliers of the uncertain inputs, relative to each other, are the constant scales D of the
structured gain (Packard and Doyle 1993) on a grid of frequencies, with κ of the trigger: where the
gain around all of them is less than one, a Lyapunov matrix exists.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from canroll.extensions.certify.uncertain_loop import UncertainLoop
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.state_space import Complex

FREQUENCIES = 80
"""Of the grid."""
KAPPA = -1.0
"""At which the search starts: near the best of all laws and buses tried."""
ITERATIONS = 300
NONE = 1e-6
"""Gain that counts as none, relative to the greatest."""


class Responses:
    """Responses of the loop to its inputs and the places of its delays.

    Attributes:
        gains: (frequencies, rows, columns) of the jumps, of the roll angle and, with a trigger, of
            the command that is sent and of the one before.
        rows: number of the uncertain input against which each row of :meth:`centred` but the last,
            the roll angle, is small; the trigger's comes first.
        columns: number of the uncertain input of each column, −1 of roundings and disturbances.
    """

    def __init__(self, loop: UncertainLoop) -> None:
        self._trigger = trigger = loop.trigger
        n, m = loop.inputs.shape
        first = 0 if trigger is None else 1
        delays = first + np.arange(len(loop.jumps))
        self.rows: Matrix = np.r_[np.zeros(2 * first, int), delays]
        places = np.repeat(delays, [g.shape[1] for g in loop.places])
        self.columns: Matrix = np.r_[np.zeros(first, int), np.full(m - first, -1), places]
        rows = np.vstack([loop.jumps, np.r_[loop.roll, np.zeros(m)]])
        if trigger is not None:
            rows = np.vstack([rows, trigger.sent, trigger.before])
        z = np.exp(1j * np.geomspace(1e-3, np.pi, FREQUENCIES))[:, None, None]
        b = np.hstack([loop.inputs, *loop.places]).astype(complex)
        gains = rows[:, :n] @ np.linalg.solve(z * np.eye(n) - loop.a, b)
        gains[:, :, :m] += rows[:, n:]
        self.gains = gains

    def centred(self, kappa: float) -> Complex:
        """Return those of the loop centred with κ, (frequencies, rows, columns).

        Rows are what is withheld, the jumps and the roll angle.
        """
        trigger, gains = self._trigger, self.gains
        if trigger is None:
            return gains
        new, before = gains[:, -2].copy(), gains[:, -1]
        new[:, 0] -= 1.0
        of_new, of_before = trigger.centre(kappa)
        centre = of_new * new + of_before * before
        small = np.sqrt(trigger.share / trigger.curvature(kappa)) * new
        gains = np.stack([centre, small, *gains[:, :-2].swapaxes(0, 1)], axis=1)
        fed = centre / (1.0 - centre[:, :1])
        return np.asarray(gains + gains[:, :, :1] * fed[:, None])


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
