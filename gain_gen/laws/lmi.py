"""Linear matrix inequalities as parametrised programs, built once and solved at many points.

Everything here is in the units of :class:`gain_gen.models.roll.NormalisedPlant`, or of the loop for
:func:`certify_level`: in N·m the solvers report wrong optima. Each program is disciplined in its
parameters, so a scan does not compile it again. These modules alone import cvxpy, which takes half
a second.
"""

import time
import warnings
from dataclasses import dataclass
from typing import Any

import cvxpy as cp
import numpy as np

from gain_gen.analysis.level_certificate import SwitchedLoop
from gain_gen.models.roll import Matrix, NormalisedPlant

SOLVER = "CLARABEL"
STRICT = 1e-6
"""Margin by which every inequality must be inside the cone."""
LEVEL_STRICT = 1e-5
"""The same for the level certificate."""

E11 = np.array([[1.0, 0.0], [0.0, 0.0]])
E12 = np.array([[0.0, 1.0], [1.0, 0.0]])
E22 = np.array([[0.0, 0.0], [0.0, 1.0]])


@dataclass(slots=True)
class Clock:
    """Time spent in solvers, s, and number of calls."""

    seconds: float = 0.0
    solves: int = 0


def solved(problem: cp.Problem, clock: Clock) -> bool:
    """Solve; return whether an optimum was found. Inaccurate ones are verified by the caller."""
    started = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            problem.solve(solver=SOLVER)
    except cp.error.SolverError:
        return False
    finally:
        clock.seconds += time.perf_counter() - started
        clock.solves += 1
    return problem.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)


def negative(blocks: list[list[Any]]) -> Any:  # noqa: ANN401
    """Return the constraint that a symmetric block matrix is negative definite."""
    matrix = cp.bmat(blocks)
    size = matrix.shape[0]
    return 0.5 * (matrix + matrix.T) << -STRICT * np.eye(size)


def scalar(value: Any) -> Any:  # noqa: ANN401
    """Return a scalar expression as a (1, 1) block."""
    return cp.reshape(value, (1, 1), order="F")


@dataclass(frozen=True, slots=True)
class StaticPoint:
    """Solution of a static output feedback program, normalised.

    Attributes:
        gamma_squared: certified level.
        gain: K on the normalised roll rate.
        x: (2, 2).
        y: scalar of the delay theorem, zero without one.
        q: (2, 2), likewise.
    """

    gamma_squared: float
    gain: float
    x: Matrix
    y: float
    q: Matrix


class StaticVariables:
    """X with X12 = −ρ X22 and W = n [−ρ, 1], so that W = K C1 X with K = n / X22 exactly."""

    def __init__(self) -> None:
        self.x11 = cp.Variable()
        self.x22 = cp.Variable(nonneg=True)
        self.n = cp.Variable()
        self.level = cp.Variable(nonneg=True)
        self.rho = cp.Parameter(nonneg=True)
        self.x = self.x11 * E11 - (self.rho * self.x22) * E12 + self.x22 * E22
        self.w = (self.rho * self.n) * np.array([[-1.0, 0.0]]) + self.n * np.array([[0.0, 1.0]])

    def point(self, y: float, q: Matrix) -> StaticPoint:
        """Return the solution; X is rebuilt from its entries so that its structure is exact."""
        rho, x11, x22 = float(self.rho.value), float(self.x11.value), float(self.x22.value)
        x = x11 * E11 - rho * x22 * E12 + x22 * E22
        return StaticPoint(float(self.level.value), float(self.n.value) / x22, x, y, q)


class DelayProgram:
    """The delay theorem of Redondo 2021, (44)–(45), corrected.

    Block (4,5) is −Y B'; L and S decouple and are dropped; the second inequality is made
    symmetric with a scanned ε: −2 ε X + ε² Q bounds −X Q⁻¹ X from above for every ε.
    """

    def __init__(self, plant: NormalisedPlant) -> None:
        self.plant = plant
        v = self.variables = StaticVariables()
        self.y = cp.Variable(nonneg=True)
        self.q = cp.Variable((2, 2), symmetric=True)
        self.epsilon = cp.Parameter(nonneg=True)
        self.epsilon_squared = cp.Parameter(nonneg=True)
        self.epsilon_rho = cp.Parameter(nonneg=True)
        self.rate = cp.Parameter(nonneg=True)
        a, b, bw, c = plant.a, plant.b, plant.b_disturbance, plant.performance
        closed = a @ v.x + b @ v.w
        zero = np.zeros
        first = [
            [closed + closed.T, bw, -b * self.y, closed.T, v.x @ c.T],
            [bw.T, -v.level * np.eye(3), zero((3, 1)), bw.T, zero((3, 1))],
            [-b.T * self.y, zero((1, 3)), -scalar(self.rate * self.y), -b.T * self.y, zero((1, 1))],
            [closed, bw, -b * self.y, -self.rate * self.q, zero((2, 1))],
            [c @ v.x, zero((1, 3)), zero((1, 1)), zero((1, 2)), -np.eye(1)],
        ]
        scaled_x = (
            (self.epsilon * v.x11) * E11
            - (self.epsilon_rho * v.x22) * E12
            + (self.epsilon * v.x22) * E22
        )
        second = [[-2 * scaled_x + self.epsilon_squared * self.q, v.w.T], [v.w, -scalar(self.y)]]
        self.problem = cp.Problem(
            cp.Minimize(v.level),
            [
                negative(first),
                negative(second),
                v.x >> STRICT * np.eye(2),
                self.q >> STRICT * np.eye(2),
            ],
        )

    def solve(self, rho: float, epsilon: float, delay: float, clock: Clock) -> StaticPoint | None:
        """Return the optimum at ρ, ε and a normalised delay, or None."""
        self.variables.rho.value = rho
        self.epsilon.value = epsilon
        self.epsilon_squared.value = epsilon**2
        self.epsilon_rho.value = epsilon * rho
        self.rate.value = 1.0 / delay
        if not solved(self.problem, clock):
            return None
        return self.variables.point(float(self.y.value), np.asarray(self.q.value))


class BoundedProgram:
    """The delay-free inequality of Redondo 2021, (52), with a bound on the closed loop's speed.

    Without it, inf γ is approached only as the gain goes to infinity. Poles stay right of −α:
    He(A X + B W) + 2 α X > 0.
    """

    def __init__(self, plant: NormalisedPlant, fastest: float) -> None:
        v = self.variables = StaticVariables()
        a, b, bw, c = plant.a, plant.b, plant.b_disturbance, plant.performance
        closed = a @ v.x + b @ v.w
        zero = np.zeros
        blocks = [
            [closed + closed.T, bw, v.x @ c.T],
            [bw.T, -v.level * np.eye(3), zero((3, 1))],
            [c @ v.x, zero((1, 3)), -np.eye(1)],
        ]
        speed = closed + closed.T + 2.0 * fastest * v.x
        self.problem = cp.Problem(
            cp.Minimize(v.level),
            [
                negative(blocks),
                0.5 * (speed + speed.T) >> STRICT * np.eye(2),
                v.x >> STRICT * np.eye(2),
            ],
        )

    def solve(self, rho: float, clock: Clock) -> StaticPoint | None:
        """Return the optimum at ρ, or None."""
        self.variables.rho.value = rho
        if not solved(self.problem, clock):
            return None
        return self.variables.point(0.0, np.zeros((2, 2)))


@dataclass(frozen=True, slots=True)
class DiscretePoint:
    """Discrete H∞ state feedback, scaled: level χ, P (n, n), Y (1, n)."""

    chi: float
    p: Matrix
    y: Matrix


def discrete_h_infinity(
    phi: Matrix, gamma: Matrix, pi: Matrix, *, c: Matrix, d: Matrix, clock: Clock
) -> DiscretePoint | None:
    """Return the optimum of Yim 2020, (12), on scaled matrices, or None.

    u = Y P⁻¹ x, z = C x + D u, w one disturbance.
    """
    n, m = gamma.shape
    p = cp.Variable((n, n), symmetric=True)
    y = cp.Variable((m, n))
    chi = cp.Variable(nonneg=True)
    forward = phi @ p + gamma @ y
    out = c @ p + d @ y
    outputs, inputs = len(c), pi.shape[1]
    zero = np.zeros
    blocks = [
        [-p, forward, pi, zero((n, outputs))],
        [forward.T, -p, zero((n, inputs)), out.T],
        [pi.T, zero((inputs, n)), -chi * np.eye(inputs), zero((inputs, outputs))],
        [zero((outputs, n)), out, zero((outputs, inputs)), -chi * np.eye(outputs)],
    ]
    # without the margin of the other programs: the optimum is flat, the level is checked exactly
    matrix = cp.bmat(blocks)
    problem = cp.Problem(cp.Minimize(chi), [0.5 * (matrix + matrix.T) << 0, p >> 1e-9 * np.eye(n)])
    if not solved(problem, clock):
        return None
    return DiscretePoint(float(chi.value), np.asarray(p.value), np.asarray(y.value))


@dataclass(frozen=True, slots=True)
class LevelPoint:
    """Solution of the level program: γ² in the loop's unit, P (n, n) and the error's weight λ."""

    level_squared: float
    p: Matrix
    weight: float


def certify_level(loop: SwitchedLoop, epsilon: float, clock: Clock) -> LevelPoint | None:
    """Return the least level that one P certifies for all delays of ``loop``, or None.

    The certificate of :mod:`gain_gen.analysis.level_certificate` as a semidefinite program.

    Args:
        loop: loop at a few delays; each is a block.
        epsilon: relative threshold of the event trigger, or zero.
        clock: accumulates the time in solvers.
    """
    n = len(loop.a[0])
    p = cp.Variable((n, n), symmetric=True)
    level = cp.Variable(nonneg=True)
    weight = cp.Variable(nonneg=True)
    constraints = [p >> LEVEL_STRICT * np.eye(n)]
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
        constraints.append(0.5 * (matrix + matrix.T) << -LEVEL_STRICT * np.eye(n + inputs))
    if not solved(cp.Problem(cp.Minimize(level), constraints), clock):
        return None
    return LevelPoint(
        float(level.value), np.asarray(p.value), float(weight.value) if epsilon else 0.0
    )
