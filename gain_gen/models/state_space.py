"""Linear systems in state space, continuous or sampled: response, norm, balanced reduction."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_continuous_lyapunov, svd

from canroll.gain_gen.models.roll import Matrix, stationary_covariance

Complex = NDArray[np.complexfloating[Any, Any]]

LEAST_VALUE = 1e-9
"""Hankel singular value, over the largest, below which a state is left out."""


def resolvent(a: Matrix, b: Matrix, points: Complex) -> Complex:
    """Return (p − A)⁻¹ B at every point p of the plane of s or z, (points, n, inputs)."""
    shifted = points[:, None, None] * np.eye(len(a)) - a
    columns = np.broadcast_to(b.astype(complex), (len(points), *b.shape))
    return np.asarray(np.linalg.solve(shifted, columns), dtype=complex)


def resolvent_rows(a: Matrix, c: Matrix, points: Complex) -> Complex:
    """Return C (p − A)⁻¹ at every point p, (points, outputs, n)."""
    return resolvent(a.T, c.T, points).transpose(0, 2, 1)


def peak(gains: Callable[[Matrix], Matrix], grid: Matrix) -> float:
    """Return the largest of gains over frequency, on a grid refined three times about it."""
    largest = 0.0
    for _ in range(4):
        values = gains(grid)
        at = int(np.argmax(values))
        largest = float(values[at])
        grid = np.linspace(grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)], 41)
    return largest


@dataclass(frozen=True, slots=True)
class StateSpace:
    """x' = A x + B u, y = C x + D u; with a ``tick`` x' is the next state.

    Attributes:
        a: (n, n).
        b: (n, inputs).
        c: (outputs, n).
        d: (outputs, inputs).
        tick: s; 0 of a continuous system.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    tick: float = 0.0

    @property
    def stable(self) -> bool:
        """Whether all its own motion decays."""
        poles = np.linalg.eigvals(self.a)
        return bool(np.all(np.abs(poles) < 1.0 if self.tick else poles.real < 0.0))

    def response(self, frequencies: Matrix) -> Complex:
        """Return C (p − A)⁻¹ B + D at ``frequencies`` in rad/s, (frequencies, outputs, inputs)."""
        points = np.exp(1j * frequencies * self.tick) if self.tick else 1j * frequencies
        return np.asarray(self.c @ resolvent(self.a, self.b, points) + self.d, dtype=complex)

    def gains(self, frequencies: Matrix) -> Matrix:
        """Return the largest singular value of the response at ``frequencies``; inf if unstable."""
        if not self.stable:
            return np.full(len(frequencies), np.inf)
        return np.asarray(np.linalg.norm(self.response(frequencies), 2, axis=(1, 2)))

    def balanced(
        self, inputs: Matrix | float = 1.0, outputs: Matrix | float = 1.0
    ) -> tuple[Self, Matrix]:
        """Return the system in balanced coordinates and its Hankel singular values, descending.

        Square-root method (Tombs, Postlethwaite 1987).

        Args:
            inputs: typical size of each input, (inputs,); zero excludes one from the balance.
            outputs: typical size of each output, (outputs,); infinity excludes one.

        Raises:
            ValueError: it is not stable.
        """
        if not self.stable:
            raise ValueError("only a stable system can be balanced")
        b, c = self.b * inputs, self.c / np.reshape(outputs, (-1, 1))
        if self.tick:
            reached = stationary_covariance(self.a, b @ b.T)
            observed = stationary_covariance(self.a.T, c.T @ c)
        else:
            reached = solve_continuous_lyapunov(self.a, -b @ b.T)
            observed = solve_continuous_lyapunov(self.a.T, -c.T @ c)
        # states of a car differ in size by orders, a controller has states that nothing reaches
        reach, observe = (_root(gramian, even=self.tick > 0.0) for gramian in (reached, observed))
        left, values, right = svd(observe.T @ reach)
        keep = values > LEAST_VALUE * values[0]
        scale = 1.0 / np.sqrt(values[keep])
        into = reach @ right.T[:, keep] * scale
        out = (observe @ left[:, keep] * scale).T
        moved = replace(self, a=out @ self.a @ into, b=out @ self.b, c=self.c @ into)
        return moved, values[keep]

    def truncated(self, order: int) -> Self:
        """Return the first ``order`` states of a balanced system, which remain stable."""
        return replace(self, a=self.a[:order, :order], b=self.b[:order], c=self.c[:, :order])

    def residualised(self, order: int) -> Self:
        """Return the first ``order`` states of a balanced system, the others at steady values.

        The steady response stays exact (singular perturbation; Fernando, Nicholson 1982).
        """
        if order >= len(self.a):
            return self
        slow, fast = slice(order), slice(order, None)
        rest = self.a[fast, fast] - np.eye(len(self.a) - order) * bool(self.tick)
        settled = np.linalg.solve(rest, np.hstack([self.a[fast, slow], self.b[fast]]))
        states, inputs = settled[:, :order], settled[:, order:]
        return replace(
            self,
            a=self.a[slow, slow] - self.a[slow, fast] @ states,
            b=self.b[slow] - self.a[slow, fast] @ inputs,
            c=self.c[:, slow] - self.c[:, fast] @ states,
            d=self.d - self.c[:, fast] @ inputs,
        )


def _root(gramian: Matrix, *, even: bool) -> Matrix:
    """Return L with L L' = the Gramian, made positive definite by a little of each state's size.

    ``even``: all states have their mean size.
    """
    symmetric = 0.5 * (gramian + gramian.T)
    squares = np.diag(symmetric)
    sizes = np.sqrt(np.full_like(squares, np.mean(squares)) if even else squares)
    scaled = symmetric / np.outer(sizes, sizes) + 1e-13 * np.eye(len(symmetric))
    root: Matrix = sizes[:, None] * cholesky(scaled, lower=True)
    return root
