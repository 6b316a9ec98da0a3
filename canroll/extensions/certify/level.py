"""Multipliers of a level claim: the mean-square gain from a held roll moment to the roll angle.

At each frequency the checker's form is one in the inputs alone, and linear in the multipliers: the
least γ² with which all are positive is a semidefinite programme. It is solved by cutting planes
(Kelley 1960): linear programmes for the inputs with which the last multipliers failed.

A rounding, at most ν, with the gain g to the roll angle and the multiplier m raises γ² by a part of
g²/m and the level of the ellipsoid, in which no stored value may saturate, by m ν². For a given
raise the level is least with m as g/ν.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.optimize import linprog

from canroll.extensions.certify.lyapunov import GRANTED, LyapunovPoint, fits, solved, uncentred
from canroll.extensions.certify.responses import Responses
from canroll.extensions.certify.uncertain_loop import UncertainLoop
from canroll.gain_gen.models.roll import Matrix, stationary_covariance
from canroll.gain_gen.models.state_space import Complex

PARTS = (0.1, 0.02, 0.005, 1e-3)
"""Tried 1 − decay, relative to that of the loop with the middle delays."""
APART = 1e3
"""Inverse of the part of γ² by which all roundings raise it on their way to the roll angle."""
RAISED = (1.003, 1.01, 1.03, 1.06, 1.1, 1.2, 1.4)
"""Factors on the least γ² of the grid that are tried."""
CLEAR = 1.03
"""Factor on the energy of what is uncertain, so that the least γ² lies within what is feasible."""
PLANES = 100
"""Linear programmes at most."""
FAILS = 1e-3
"""Least eigenvalue of a form that counts as negative, with inputs of roll angles of about one."""


def level_points(loop: UncertainLoop) -> Iterator[LyapunovPoint]:
    """Yield points for the least levels; the last input is the moment, its multiplier γ²."""
    if loop.radius >= 1.0:
        return
    least = _Programme(loop).solved()
    if least is None:
        return
    centred, trigger = loop.centred(least.kappa), loop.trigger
    gap, sizes = 1.0 - centred.radius**2, _sizes(centred)
    others = least.inputs[:-1].copy()
    if trigger:  # of the square that is left of it
        others[0] *= trigger.curvature(least.kappa)
    for factor, part in product(RAISED, PARTS if gap > 0.0 else ()):
        weights = np.r_[others, factor * least.inputs[-1]]
        point = solved(centred, 1.0 - part * gap, least.delays, weights, sizes, performance=1.0)
        if point is not None and fits(centred, point):
            point = replace(point, roll=float(np.sqrt(weights[-1])))
            yield uncentred(point, trigger, least.kappa) if trigger else point


@dataclass(frozen=True, slots=True)
class _Multipliers:
    """Multipliers of the delays and of the inputs, the last one γ², and κ of the trigger."""

    delays: Matrix
    inputs: Matrix
    kappa: float


class _Programme:
    """The least γ² such that Σ t_k Q_k − C is positive at every frequency, with every t_k ≥ 0.

    Q_k are the forms of the trigger, of −κ, of each delay and of the moment, C that of the roll
    angle less the roundings. An input is scaled by its gain to the roll angle.
    """

    def __init__(self, loop: UncertainLoop) -> None:
        responses, self._trigger = Responses(loop), loop.trigger
        gains, of, delays = responses.gains, responses.columns, len(loop.jumps)
        moment, first = loop.inputs.shape[1] - 1, 1 if loop.trigger else 0
        rounded = slice(first, moment)
        units = np.abs(gains[:, delays]).max(axis=0) ** 2
        self._roundings = _weights(np.sqrt(units[rounded]), loop.bounds[rounded])
        units[rounded] = self._roundings
        columns = [of == number for number in range(first + delays)]
        for column in columns:
            units[column] = units[column].max()
        gains = gains / np.sqrt(units)
        each = np.eye(len(units))
        scales = [units[column].max() for column in columns]
        rows = [gains[:, j] for j in range(delays)]
        if loop.trigger:
            sent, change = gains[:, -2], gains[:, -2] - gains[:, -1]
            rows = [np.sqrt(loop.trigger.share) * sent, *rows]
        forms = [
            np.diag(1.0 * column) - CLEAR * scale * _square(row)
            for column, scale, row in zip(columns, scales, rows, strict=True)
        ]
        if loop.trigger:
            between = np.sqrt(units[0]) * each[0][:, None] * change[:, None]
            forms.insert(1, 0.5 * (between + between.conj().swapaxes(1, 2)))
            scales.insert(1, scales[0])
        self._constant: Complex = _square(gains[:, delays]) - np.diag(each[rounded].sum(axis=0))
        forms.append(np.broadcast_to(np.diag(each[moment]), self._constant.shape))
        self._forms: Complex = np.array(forms)
        self._scales: Matrix = np.array([*scales, units[moment]])

    def solved(self) -> _Multipliers | None:
        """Return the multipliers of the least γ², or None where there are none."""
        planes, least = list[Matrix](), list[Matrix]()
        free: Matrix = np.zeros(len(self._scales))
        for _ in range(PLANES):
            values, vectors = np.linalg.eigh(np.tensordot(free, self._forms, 1) - self._constant)
            fails = values[:, 0] < -FAILS
            if not fails.any():
                break
            v = vectors[fails, :, 0]
            planes.append(np.einsum("fi,kfij,fj->fk", v.conj(), self._forms[:, fails], v).real)
            least.append(np.einsum("fi,fij,fj->f", v.conj(), self._constant[fails], v).real)
            squared = np.arange(len(free)) == len(free) - 1
            answer = linprog(squared, -np.vstack(planes), -np.concatenate(least))
            if not answer.success:
                return None
            free = np.asarray(answer.x)
        else:
            return None
        free = free * self._scales
        if self._trigger is None:
            return _Multipliers(free[:-1], np.r_[self._roundings, free[-1]], 0.0)
        inputs = np.r_[free[0], self._roundings, free[-1]]
        return _Multipliers(free[2:-1], inputs, -float(free[1] / free[0]))


def _weights(gains: Matrix, bounds: Matrix) -> Matrix:
    """Return the multipliers of roundings with the least level for a given raise of γ²."""
    reach = gains * bounds
    granted = np.maximum(reach, GRANTED * reach.sum())
    return np.asarray(APART * granted * granted.sum() / bounds**2)


def _square(row: Complex) -> Complex:
    """Return the form of |row · inputs|² at every frequency."""
    form: Complex = row.conj()[:, :, None] * row[:, None, :]
    return form


def _sizes(loop: UncertainLoop) -> Matrix:
    """Return typical sizes of the states under a white moment."""
    moment = loop.inputs[:, -1]
    sizes = np.sqrt(np.diag(stationary_covariance(loop.a, np.outer(moment, moment))))
    return np.asarray(np.where(sizes > 0.0, sizes, 1.0))
