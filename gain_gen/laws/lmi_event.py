"""The inequality of the event-triggered delay loop as a parametrised program, at a fixed gain."""

from collections.abc import Callable
from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from gain_gen.laws.lmi import STRICT, Clock, solved
from gain_gen.models.roll import Matrix, NormalisedPlant


@dataclass(frozen=True, slots=True)
class EventPoint:
    """Lyapunov–Krasovskii certificate of an event-triggered loop, normalised.

    Attributes:
        gamma_squared: certified level.
        p: (2, 2).
        r: weight of the delay term.
        s: weight of the delayed output, zero for sampled or varying delay.
        omega: weight of the trigger.
    """

    gamma_squared: float
    p: Matrix
    r: float
    s: float
    omega: float


class EventProgram:
    """Event-triggered delay loop at a fixed gain: minimise γ² over P, R, Ω.

    ψ = [x; q = K C1 x(t − τ); e = K e_y; w], x' = A x + B q − B e + Bw w, ũ = q − e and the
    trigger ensures e² ≤ ε² ũ². The 2022 paper prints no inequality; S = 0, so the delay may vary.
    """

    def __init__(self, plant: NormalisedPlant) -> None:
        a, b, bw, c = plant.a, plant.b, plant.b_disturbance, plant.performance
        self.level = cp.Variable(nonneg=True)
        self.p = cp.Variable((2, 2), symmetric=True)
        self.r = cp.Variable(nonneg=True)
        self.omega = cp.Variable(nonneg=True)
        self.gain_squared_rate = cp.Parameter(nonneg=True)
        self.gain_rate = cp.Parameter()
        self.rate = cp.Parameter(nonneg=True)
        self.gain_squared_delay = cp.Parameter(nonneg=True)
        self.epsilon_squared = cp.Parameter(nonneg=True)
        flow = np.hstack([a, b, -b, bw])
        pick = np.eye(7)
        ex, eq, ee, ew = pick[:2], pick[2:3], pick[3:4], pick[4:]
        rate_of = ex[1:2]
        lyapunov = ex.T @ self.p @ flow
        sent = eq - ee
        matrix = (
            lyapunov
            + lyapunov.T
            + ex.T @ c.T @ c @ ex
            - self.level * (ew.T @ ew)
            + (self.omega * self.epsilon_squared) * (sent.T @ sent)
            - self.omega * (ee.T @ ee)
            - (self.r * self.gain_squared_rate) * (rate_of.T @ rate_of)
            + (self.r * self.gain_rate) * (rate_of.T @ eq + eq.T @ rate_of)
            - (self.r * self.rate) * (eq.T @ eq)
            + (self.r * self.gain_squared_delay) * (flow[1:2].T @ flow[1:2])
        )
        self.problem = cp.Problem(
            cp.Minimize(self.level),
            [0.5 * (matrix + matrix.T) << -STRICT * np.eye(7), self.p >> STRICT * np.eye(2)],
        )

    def solve(
        self, gain: float, delay: float, epsilon_squared: float, clock: Clock
    ) -> EventPoint | None:
        """Return the optimum at a normalised gain and delay, or None."""
        self.gain_squared_rate.value = gain**2 / delay
        self.gain_rate.value = gain / delay
        self.rate.value = 1.0 / delay
        self.gain_squared_delay.value = gain**2 * delay
        self.epsilon_squared.value = epsilon_squared
        if not solved(self.problem, clock):
            return None
        return EventPoint(
            float(self.level.value),
            np.asarray(self.p.value),
            float(self.r.value),
            0.0,
            float(self.omega.value),
        )


def fixed_lyapunov_certificate(
    blocks: Callable[..., Matrix], p: Matrix, gain: float, clock: Clock
) -> EventPoint | None:
    """Return the best R, S, Ω and level for a given P, or None if infeasible.

    Args:
        blocks: the inequality as function of p, r, s, omega, gamma_squared; affine in them.
        p: P as printed, (2, 2).
        gain: N·m·s/rad, by which q and e are scaled.
        clock: accumulates the time in solvers.
    """
    nothing = {"p": np.zeros((2, 2)), "r": 0.0, "s": 0.0, "omega": 0.0, "gamma_squared": 0.0}
    scale = np.diag([1.0, 1.0, abs(gain), abs(gain), 1.0, 1.0, 1.0])
    base = scale @ blocks(**nothing) @ scale

    def direction(**change: float | Matrix) -> Matrix:
        moved: Matrix = scale @ blocks(**(nothing | change)) @ scale - base
        return moved

    unit = gain**-2
    weights = cp.Variable(3, nonneg=True)
    level = cp.Variable(nonneg=True)
    matrix = base + direction(p=p) + level * direction(gamma_squared=1.0)
    for i, name in enumerate(("r", "s", "omega")):
        matrix = matrix + weights[i] * (unit * direction(**{name: 1.0}))
    if not solved(cp.Problem(cp.Minimize(level), [matrix << -STRICT * np.eye(7)]), clock):
        return None
    r, s, omega = (float(value) * unit for value in weights.value)
    return EventPoint(float(level.value), p, r, s, omega)
