"""Lyapunov matrix and multipliers of a loop whose limit of moment acts, in floating point.

The limit adds multipliers that no Riccati equation has, so this is a semidefinite programme, linear
in all but the decay: the least level to which roundings drive V, with V no less than the sum of the
squares of the states, each relative to its size in the loop without the limit.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from canroll.extensions.certify.lyapunov import ROOM, SLACK, LyapunovPoint, nominal
from canroll.extensions.certify.uncertain_loop import UncertainLoop
from canroll.gain_gen.laws.lmi import NONNEG, SCALAR, Clock, Unknown, minimise
from canroll.gain_gen.models.roll import Matrix

DECAYS = (0.2, 0.05, 0.02)
"""Tried 1 − decay, relative to that of the loop with the middle delays."""
STRICT = 1e-6
"""Margin of the inequality."""


def limited_points(loop: UncertainLoop) -> Iterator[LyapunovPoint]:
    """Yield feasible points, the largest decay first."""
    gap = 1.0 - loop.radius**2
    for part in DECAYS if gap > 0.0 else ():
        point = _Programme(loop, 1.0 - part * gap).solved()
        if point is not None:
            yield point


class _Programme:
    """The inequality of the checker in signals that are scaled to their sizes."""

    def __init__(self, loop: UncertainLoop, decay: float) -> None:
        n, m = loop.inputs.shape
        self._loop, self._decay = loop, decay
        typical = nominal(replace(loop, inputs=loop.inputs[:, :-1]), decay)
        row = loop.opposed[0][1][:n]
        unit = float(np.sqrt(row @ typical.covariance @ row)) or 1.0
        self._sizes = np.r_[typical.sizes[:-2], unit, unit]
        # the cut is the size of the command, as what is withheld
        bounded = np.where(loop.bounds > 0.0, loop.bounds, 1.0)
        if loop.trigger:
            bounded[0] = unit
        self._cost = (loop.bounds / bounded) ** 2
        self._inputs, self._unit = np.r_[bounded, unit], unit
        scale = np.r_[self._sizes, self._inputs]
        places = [g * unit for g in loop.places]
        after = np.hstack([np.hstack([loop.a, loop.inputs]) * scale, *places])
        self._after = after / self._sizes[:, None]
        self._each = np.eye(after.shape[1])
        ends = n + m + np.cumsum([0, *(g.shape[1] for g in loop.places)])
        self._places = [self._each[a:b] for a, b in pairwise(ends)]

        def scaled(rows: Matrix) -> Matrix:
            return np.hstack([rows * scale / unit, np.zeros((len(rows), ends[-1] - n - m))])

        self._opposed = [scaled(np.array(pair)) for pair in loop.opposed]
        self._jumps = scaled(loop.jumps)
        if loop.trigger:
            self._rows = scaled(np.vstack([loop.trigger.sent, loop.trigger.before]))

    def _forms(self, level: float, p: Matrix, **free: Any) -> tuple[Matrix, ...]:  # noqa: ANN401
        """Return what must be negative definite."""
        n, loop = len(p), self._loop
        form: Matrix = (1.0 + 2.0 * SLACK) * self._after.T @ p @ self._after
        form[:n, :n] -= self._decay * p
        for j, (jump, places) in enumerate(zip(self._jumps, self._places, strict=True)):
            form += free[f"d{j}"] * (ROOM * np.outer(jump, jump) - places.T @ places)
        for i, (cut, by) in enumerate(self._opposed):
            form -= free[f"c{i}"] * (np.outer(cut, by) + np.outer(by, cut))
        if loop.trigger:
            (sent, before), withheld = self._rows, self._each[n]
            form += free["m0"] * loop.trigger.share * np.outer(sent, sent)
            kept = np.outer(withheld, sent - before)
            form += free["switching"] * (kept + kept.T)
        m = [free[f"m{i}"] for i in range(len(self._cost))]
        form[range(n, n + len(m)), range(n, n + len(m))] -= m
        return form, np.eye(n) - p, np.array([[self._cost @ m - level]])

    def solved(self) -> LyapunovPoint | None:
        """Return the point, or None where there is none."""
        loop = self._loop
        unknowns: dict[str, Unknown] = {"level": NONNEG, "p": len(loop.a)}
        names = [f"m{i}" for i in range(len(self._cost))]
        names += [f"d{j}" for j in range(len(loop.jumps))]
        names += [f"c{i}" for i in range(len(self._opposed))]
        unknowns |= dict.fromkeys(names, NONNEG)
        if loop.trigger:
            unknowns["switching"] = SCALAR
        point = minimise(self._forms, unknowns, Clock(), strict=STRICT)
        if point is None:
            return None
        m, d, c = (np.array([point[name] for name in names if name[0] == kind]) for kind in "mdc")
        p = point["p"] / np.outer(self._sizes, self._sizes)
        w = np.linalg.inv(p)
        return LyapunovPoint(
            p,
            self._decay,
            d / self._unit**2,
            m / self._inputs[:-1] ** 2,
            2.0 * point["switching"] / self._unit**2 if loop.trigger else 0.0,
            float(np.sqrt(loop.roll @ w @ loop.roll)),
            w,
            2.0 * c / self._unit**2,
        )
