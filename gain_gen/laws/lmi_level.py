"""The level certificate as a semidefinite program; :mod:`gain_gen.analysis.level_certificate`."""

from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from gain_gen.analysis.level_certificate import SwitchedLoop
from gain_gen.laws.lmi import Clock, solved
from gain_gen.models.roll import Matrix

STRICT = 1e-5
"""Margin by which every inequality must be inside the cone."""


@dataclass(frozen=True, slots=True)
class LevelPoint:
    """What the program returns: γ² in the loop's unit, P (n, n) and the error's weight λ."""

    level_squared: float
    p: Matrix
    weight: float


def certify_level(loop: SwitchedLoop, epsilon: float, clock: Clock) -> LevelPoint | None:
    """Return the least level that one P certifies for all delays of ``loop``, or None.

    Args:
        loop: at few delays: each is a block.
        epsilon: relative threshold of the event trigger, or zero.
        clock: of the solver.
    """
    n = len(loop.a[0])
    p = cp.Variable((n, n), symmetric=True)
    level = cp.Variable(nonneg=True)
    weight = cp.Variable(nonneg=True)
    constraints = [p >> STRICT * np.eye(n)]
    inputs = 2 if epsilon else 1
    pick = np.eye(n + inputs)
    state, disturbance = pick[:, :n], pick[:, n : n + 1]
    for a, b in zip(loop.a, loop.b, strict=True):
        joint = np.hstack([a, b[:, :inputs]])
        matrix = joint.T @ p @ joint - state @ p @ state.T
        matrix = matrix + state @ (loop.z.T @ loop.z) @ state.T
        matrix = matrix - level * (disturbance @ disturbance.T)
        if epsilon:
            sent = np.hstack([loop.v, [[0.0, 1.0]]])
            error = pick[:, n + 1 :]
            matrix = matrix + weight * (epsilon**2 * sent.T @ sent - error @ error.T)
        constraints.append(0.5 * (matrix + matrix.T) << -STRICT * np.eye(n + inputs))
    if not solved(cp.Problem(cp.Minimize(level), constraints), clock):
        return None
    return LevelPoint(
        float(level.value), np.asarray(p.value), float(weight.value) if epsilon else 0.0
    )
