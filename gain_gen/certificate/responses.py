"""Responses of an uncertain loop over frequency, for any κ of its trigger."""

import numpy as np

from gain_gen.certificate.uncertain_loop import UncertainLoop
from gain_gen.models.roll import Matrix
from gain_gen.models.state_space import Complex

FREQUENCIES = 80
"""Of the grid."""


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
