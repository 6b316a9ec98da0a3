"""Numerical evaluation of the matrix inequalities at a point: eigenvalues, no solver.

The validity of a certificate is judged by these functions, not by a solver's report.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from canroll.gain_gen.models.roll import (
    PERFORMANCE,
    Matrix,
    disturbance_input,
    moment_input,
    state_matrix,
)
from canroll.gain_gen.models.state_space import resolvent
from canroll.vehicles import RollModel


def largest_eigenvalue(matrix: Matrix) -> float:
    """Return the largest eigenvalue of the symmetric part, over the matrix's own norm.

    Relative, so that "negative" means the same in every unit.
    """
    symmetric = 0.5 * (matrix + matrix.T)
    return float(np.linalg.eigvalsh(symmetric)[-1] / np.linalg.norm(symmetric, 2))


@dataclass(frozen=True, slots=True)
class CertifiedPlant:
    """The plant of the inequalities: x' = A x + B u + Bw w, z = C x, y = C1 x."""

    a: Matrix
    b: Matrix
    bw: Matrix
    c: Matrix
    c1: Matrix


def si_plant(model: RollModel, output: Matrix) -> CertifiedPlant:
    """Return the roll plant in SI units with measured output ``output``, (1, 2)."""
    return CertifiedPlant(
        state_matrix(model), moment_input(model), disturbance_input(model), PERFORMANCE, output
    )


def discrete_block(
    phi: Matrix,
    gamma: Matrix,
    pi: Matrix,
    *,
    c: Matrix,
    d: Matrix,
    p: Matrix,
    y: Matrix,
    chi: float,
) -> Matrix:
    """Return the inequality of Yim 2020, (12), at a point."""
    forward, out, zero = phi @ p + gamma @ y, c @ p + d @ y, np.zeros
    n, inputs, outputs = len(p), pi.shape[1], len(c)
    return np.block(
        [
            [-p, forward, pi, zero((n, outputs))],
            [forward.T, -p, zero((n, inputs)), out.T],
            [pi.T, zero((inputs, n)), -chi * np.eye(inputs), zero((inputs, outputs))],
            [zero((outputs, n)), out, zero((outputs, inputs)), -chi * np.eye(outputs)],
        ]
    )


def event_block(
    plant: CertifiedPlant,
    *,
    gain: float,
    p: Matrix,
    r: float,
    s: float,
    omega: float,
    gamma_squared: float,
    delay: float,
    epsilon_squared: float,
) -> Matrix:
    """Return the event-triggered inequality on ψ = [x, q, e, w] at a point, (7, 7)."""
    flow = np.hstack([plant.a, plant.b, -plant.b, plant.bw])
    pick = np.eye(7)
    ex, eq, ee, ew = pick[:2], pick[2:3], pick[3:4], pick[4:]
    measured = gain * plant.c1 @ ex
    sent, moved = eq - ee, measured - eq
    speed = gain * plant.c1 @ flow
    lyapunov = ex.T @ p @ flow
    matrix: Matrix = (
        lyapunov
        + lyapunov.T
        + ex.T @ plant.c.T @ plant.c @ ex
        - gamma_squared * ew.T @ ew
        + s * (measured.T @ measured - eq.T @ eq)
        + omega * (epsilon_squared * sent.T @ sent - ee.T @ ee)
        - r / delay * moved.T @ moved
        + delay * r * speed.T @ speed
    )
    return matrix


def certified_level(
    plant: CertifiedPlant,
    *,
    gain: float,
    p: Matrix,
    r: float,
    s: float,
    delay: float,
    epsilon_squared: float,
) -> float:
    """Return the least γ² that given P, R, S certify with the best weight Ω; infinite if none.

    The level enters only on w: γ² is the largest eigenvalue of the Schur complement.
    """

    def level(log_omega: float) -> float:
        block = event_block(
            plant,
            gain=gain,
            p=p,
            r=r,
            s=s,
            omega=float(np.exp(log_omega)),
            gamma_squared=0.0,
            delay=delay,
            epsilon_squared=epsilon_squared,
        )
        # loop quantities in units of the gain: the block spans ten decades otherwise
        scale = np.diag([1.0, 1.0, abs(gain), abs(gain), 1.0, 1.0, 1.0])
        block = scale @ block @ scale
        inner = block[:4, :4]
        if np.linalg.eigvalsh(0.5 * (inner + inner.T))[-1] >= 0.0:
            return float("inf")
        cross = block[:4, 4:]
        schur = block[4:, 4:] - cross.T @ np.linalg.solve(inner, cross)
        return float(np.linalg.eigvalsh(0.5 * (schur + schur.T))[-1])

    grid = np.linspace(-40.0, 10.0, 401)
    values = [level(float(point)) for point in grid]
    best = int(np.argmin(values))
    if not np.isfinite(values[best]):
        return float("inf")
    refined = minimize_scalar(
        level,
        bounds=(grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]),
        method="bounded",
    )
    return float(min(refined.fun, values[best]))


def event_small_gain(plant: CertifiedPlant, *, gain: float, delay: float) -> float:
    """Return max |1 / (1 − K e^{−sτ} G)|: a constant delay tolerates ε below its inverse."""
    frequencies = np.geomspace(1e-2, 2e3, 20000)
    s = 1j * frequencies
    response = plant.c1 @ resolvent(plant.a, plant.b, s)
    loop = gain * np.exp(-s * delay) * response[:, 0, 0]
    return float(np.max(np.abs(1.0 / (1.0 - loop))))
