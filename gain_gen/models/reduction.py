"""Balanced truncation of a discrete system: fewer states, the same response."""

import numpy as np
from scipy.linalg import cholesky, svd

from gain_gen.models.roll import Matrix, stationary_covariance


def balanced(a: Matrix, b: Matrix, c: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return A, B, C in balanced coordinates and the Hankel singular values, descending.

    Square-root method (Tombs, Postlethwaite 1987) on a stable system.

    Raises:
        ValueError: the system is not stable.
    """
    if np.abs(np.linalg.eigvals(a)).max() >= 1.0:
        raise ValueError("only a stable system can be balanced")
    reach = _root(stationary_covariance(a, b @ b.T))
    observe = _root(stationary_covariance(a.T, c.T @ c))
    left, values, right = svd(observe.T @ reach)
    keep = values > 1e-12 * values[0]
    inverse_root = 1.0 / np.sqrt(values[keep])
    into = reach @ right.T[:, keep] * inverse_root
    out = (observe @ left[:, keep] * inverse_root).T
    return out @ a @ into, out @ b, c @ into, values[keep]


def _root(gramian: Matrix) -> Matrix:
    """Return L with L L' = the Gramian, a whiff of identity keeping it positive definite."""
    symmetric = 0.5 * (gramian + gramian.T)
    size = float(np.trace(symmetric)) / len(symmetric)
    root: Matrix = cholesky(symmetric + 1e-13 * size * np.eye(len(symmetric)), lower=True)
    return root


def truncated(a: Matrix, b: Matrix, c: Matrix, order: int) -> tuple[Matrix, Matrix, Matrix]:
    """Return the first ``order`` states of a balanced system; it stays stable."""
    return a[:order, :order], b[:order], c[:, :order]
