"""The central H∞ controller of a continuous plant, by two Riccati equations (Glover, Doyle 1988).

In the form of Zhou, Doyle, Glover 1996, section 17.1, feedthroughs included. Callers must check the
closed loop: near the optimum a Riccati solution loses accuracy without warning.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import schur

from canroll.gain_gen.models.roll import Matrix

NEGATIVE = 1e-6
"""Share of its largest entry by which a solution's eigenvalue may seem negative."""


@dataclass(frozen=True, slots=True)
class Generalised:
    """x' = A x + B₁ w + B₂ u, z = C₁ x + D₁₁ w + D₁₂ u, y = C₂ x + D₂₁ w + D₂₂ u.

    Attributes:
        a: (n, n).
        b: (n, w + u).
        c: (z + y, n).
        d: (z + y, w + u).
        commands: how many inputs are u.
        readings: how many outputs are y.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    commands: int
    readings: int

    @property
    def sizes(self) -> tuple[int, int]:
        """Number of disturbances w and errors z."""
        return self.b.shape[1] - self.commands, len(self.c) - self.readings


Quadruple = tuple[Matrix, Matrix, Matrix, Matrix]


def central_controller(plant: Generalised, level: float) -> Quadruple | None:
    """Return A, B, C, D of u = K y such that ‖z‖ < level ‖w‖, or None if there is none.

    D₁₂ must have full column rank and D₂₁ full row rank.
    """
    m1, p1 = plant.sizes
    m2, p2 = plant.commands, plant.readings
    scaled, command, reading, through = _normalised(plant)
    a, b, c, d = scaled.a, scaled.b, scaled.c, scaled.d
    d11 = d[:p1, :m1]
    d1, d_1 = d[:p1], d[:, :m1]
    if max(np.linalg.norm(d11[: p1 - m2], 2), np.linalg.norm(d11[:, : m1 - p2], 2)) >= level:
        return None
    r = d1.T @ d1 - _block(level**2, m1, m2)
    r_dual = d_1 @ d_1.T - _block(level**2, p1, p2)
    x = _riccati(a, b, c[:p1].T @ c[:p1], d1.T @ c[:p1], r)
    y = _riccati(a.T, c.T, b[:, :m1] @ b[:, :m1].T, d_1 @ b[:, :m1].T, r_dual)
    if x is None or y is None or np.abs(np.linalg.eigvals(x @ y)).max() >= level**2:
        return None
    f = -np.linalg.solve(r, d1.T @ c[:p1] + b.T @ x)
    h = -np.linalg.solve(r_dual, d_1 @ b[:, :m1].T + c @ y).T
    f12, f2 = f[m1 - p2 : m1], f[m1:]
    h12, h2 = h[:, p1 - m2 : p1], h[:, p1:]
    first, second = d11[: p1 - m2, : m1 - p2], d11[: p1 - m2, m1 - p2 :]
    third, fourth = d11[p1 - m2 :, : m1 - p2], d11[p1 - m2 :, m1 - p2 :]
    rows = np.linalg.inv(level**2 * np.eye(p1 - m2) - first @ first.T)
    columns = np.linalg.inv(level**2 * np.eye(m1 - p2) - first.T @ first)
    k11 = -third @ first.T @ rows @ second - fourth
    k12 = np.linalg.cholesky(np.eye(m2) - third @ columns @ third.T)
    k21 = np.linalg.cholesky(np.eye(p2) - second.T @ rows @ second).T
    z = np.linalg.inv(np.eye(len(a)) - y @ x / level**2)
    b2 = z @ (b[:, m1:] + h12) @ k12
    c2 = -k21 @ (c[p1:] + f12)
    kb = -z @ h2 + b2 @ np.linalg.solve(k12, k11)
    kc = f2 + k11 @ np.linalg.solve(k21, c2)
    ka = a + b @ f + kb @ np.linalg.solve(k21, c2)
    # what the command feeds through to the readings is taken off
    around = np.linalg.inv(np.eye(m2) + k11 @ through)
    return (
        ka - kb @ through @ around @ kc,
        kb @ (np.eye(p2) - through @ around @ k11) @ reading,
        command @ around @ kc,
        command @ around @ k11 @ reading,
    )


def _normalised(plant: Generalised) -> tuple[Generalised, Matrix, Matrix, Matrix]:
    """Return the plant with D₁₂ = [0; 1], D₂₁ = [0 1], D₂₂ = 0 by a change of coordinates.

    Then R_u of u = R_u ũ, R_y of ỹ = R_y y, and D₂₂ in these coordinates.
    """
    m1, p1 = plant.sizes
    m2, p2 = plant.commands, plant.readings
    left, size, right = np.linalg.svd(plant.d[:p1, m1:])
    errors = np.hstack([left[:, m2:], left[:, :m2]])
    command = right.T / size
    left, size, right = np.linalg.svd(plant.d[p1:, :m1])
    disturbances = np.vstack([right[p2:], right[:p2]]).T
    reading = (left / size).T
    inputs, outputs = _diagonal(disturbances, command), _diagonal(errors.T, reading)
    d = outputs @ plant.d @ inputs
    through = d[p1:, m1:].copy()
    d[p1:, m1:] = 0.0
    d[:p1, m1:] = np.eye(p1)[:, p1 - m2 :]
    d[p1:, :m1] = np.eye(m1)[m1 - p2 :]
    scaled = Generalised(plant.a, plant.b @ inputs, outputs @ plant.c, d, m2, p2)
    return scaled, command, reading, through


def _diagonal(first: Matrix, second: Matrix) -> Matrix:
    """Return the block diagonal matrix of two blocks."""
    block = np.zeros((len(first) + len(second), first.shape[1] + second.shape[1]))
    block[: len(first), : first.shape[1]] = first
    block[len(first) :, first.shape[1] :] = second
    return block


def _block(value: float, size: int, zeros: int) -> Matrix:
    return np.diag([value] * size + [0.0] * zeros)


def _riccati(a: Matrix, b: Matrix, q: Matrix, s: Matrix, r: Matrix) -> Matrix | None:
    """Return the stabilising X ≥ 0 of A'X + XA + Q − (XB + S')R⁻¹(B'X + S) = 0, or None."""
    n = len(a)
    inverse = np.linalg.inv(r)
    hamiltonian = np.block([[a, np.zeros((n, n))], [-q, -a.T]])
    hamiltonian -= np.vstack([b, -s.T]) @ inverse @ np.hstack([s, b.T])
    _, basis, stable = schur(hamiltonian, output="real", sort="lhp")
    if stable != n:
        return None
    x = np.linalg.solve(basis[:n, :n].T, basis[n:, :n].T).T
    x = 0.5 * (x + x.T)
    return x if np.linalg.eigvalsh(x)[0] > -NEGATIVE * np.abs(x).max() else None
