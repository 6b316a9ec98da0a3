"""Exact analysis of x' = A x + B K x(t − τ): rightmost root, largest delay, H∞ level."""

import numpy as np

from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.state_space import Complex, peak


def chebyshev(points: int) -> tuple[Matrix, Matrix]:
    """Return the differentiation matrix and the ``points + 1`` nodes on [1, −1] (Trefethen)."""
    nodes = np.cos(np.pi * np.arange(points + 1) / points)
    weights = np.ones(points + 1)
    weights[[0, -1]] = 2.0
    weights *= (-1.0) ** np.arange(points + 1)
    difference = nodes[:, None] - nodes[None, :] + np.eye(points + 1)
    matrix = np.outer(weights, 1.0 / weights) / difference
    matrix -= np.diag(matrix.sum(axis=1))
    return matrix, nodes


def rightmost_root(a: Matrix, delayed: Matrix, delay: float, *, points: int = 32) -> complex:
    """Return the characteristic root of x' = A x + A_d x(t − τ) with the largest real part.

    Chebyshev collocation of the infinitesimal generator (Breda, Maset, Vermiglio 2005), then
    Newton steps on det(s − A − A_d e^{−sτ}) so that the answer does not depend on the grid.

    Args:
        a: (n, n).
        delayed: A_d, (n, n).
        delay: τ ≥ 0, s.
        points: collocation points; 24–40 suffice where τ·|A| is of the order of ten.
    """
    if delay <= 0.0:
        eigenvalues = np.linalg.eigvals(a + delayed)
        return complex(eigenvalues[np.argmax(eigenvalues.real)])
    n = len(a)
    matrix, _ = chebyshev(points)
    generator = np.kron(matrix * 2.0 / delay, np.eye(n))
    generator[:n] = 0.0
    generator[:n, :n] = a
    generator[:n, -n:] = delayed
    eigenvalues = np.linalg.eigvals(generator)
    candidates = eigenvalues[np.argsort(-eigenvalues.real)[:4]]
    polished = [_polish(a, delayed, delay, complex(root)) for root in candidates]
    return max(polished, key=lambda root: root.real)


def _polish(a: Matrix, delayed: Matrix, delay: float, start: complex) -> complex:
    """Newton's method on the characteristic matrix by its null vectors."""
    root = start
    identity = np.eye(len(a))
    for _ in range(20):
        characteristic = root * identity - a - delayed * np.exp(-root * delay)
        slope = identity + delay * delayed * np.exp(-root * delay)
        try:
            step = 1.0 / np.trace(np.linalg.solve(characteristic, slope))
        except np.linalg.LinAlgError:
            return root
        if not np.isfinite(step) or abs(root - step - start) > 0.2 * (1.0 + abs(start)):
            return start
        root -= step
        if abs(step) < 1e-12 * (1.0 + abs(root)):
            break
    return root


def largest_delay(a: Matrix, b: Matrix, gain: Matrix) -> float:
    """Return the largest τ for which x' = A x + B K x(t − τ') is stable for all τ' < τ, s.

    At the edge the scalar loop gain L(jω) = K (jω − A)⁻¹ B has modulus one and e^{−jωτ} turns it
    to +1: the crossing frequencies are roots of a polynomial, so nothing is missed.

    Args:
        a: (n, n).
        b: (n, 1).
        gain: K, (1, n).

    Returns:
        Seconds; infinite where no delay destabilises, zero where τ = 0 already does.
    """
    if np.linalg.eigvals(a + b @ gain).real.max() >= 0.0:
        return 0.0
    denominator = np.poly(a)
    numerator = np.poly(a - b @ gain) - denominator
    frequencies = _unit_modulus_frequencies(numerator, denominator)
    if not len(frequencies):
        return float("inf")
    loop = np.polyval(numerator, 1j * frequencies) / np.polyval(denominator, 1j * frequencies)
    return float(np.min(np.mod(np.angle(loop), 2.0 * np.pi) / frequencies))


def _unit_modulus_frequencies(numerator: Matrix, denominator: Matrix) -> Matrix:
    """Return all ω > 0 with |numerator(jω)| = |denominator(jω)|."""

    def squared_modulus(polynomial: Matrix) -> Matrix:
        signs = (-1.0) ** np.arange(len(polynomial) - 1, -1, -1)
        return np.polymul(polynomial, polynomial * signs)

    difference = np.polysub(squared_modulus(denominator), squared_modulus(numerator))
    roots = np.roots(difference)
    imaginary = roots[(np.abs(roots.real) < 1e-7 * (1.0 + np.abs(roots))) & (roots.imag > 1e-9)]
    frequencies: Matrix = np.sort(imaginary.imag)
    return frequencies


def closed_loop_response(
    a: Matrix,
    delayed: Matrix,
    b: Matrix,
    c: Matrix,
    *,
    delay: float,
    frequencies: Matrix,
) -> Complex:
    """Return C (jω − A − A_d e^{−jωτ})⁻¹ B, shape (frequencies, outputs, inputs)."""
    s = 1j * frequencies[:, None, None]
    matrix = s * np.eye(len(a)) - a - delayed * np.exp(-s * delay)
    inputs = np.broadcast_to(b, (len(frequencies), *b.shape)).astype(complex)
    return np.asarray(c @ np.linalg.solve(matrix, inputs), dtype=complex)


def h_infinity(a: Matrix, delayed: Matrix, b: Matrix, c: Matrix, *, delay: float) -> float:
    """Return the H∞ level of a delay system; infinite where it is unstable.

    Args:
        a: (n, n).
        delayed: A_d, (n, n).
        b: disturbance input, (n, m).
        c: performance output, (p, n).
        delay: s.
    """
    if rightmost_root(a, delayed, delay).real >= 0.0:
        return float("inf")
    fastest = max(
        1.0,
        float(np.abs(np.linalg.eigvals(a)).max()),
        float(np.linalg.norm(delayed, 2)),
        2.0 * np.pi / max(delay, 1e-3),
    )

    def gains(frequencies: Matrix) -> Matrix:
        response = closed_loop_response(a, delayed, b, c, delay=delay, frequencies=frequencies)
        return np.asarray(np.linalg.norm(response, 2, axis=(1, 2)))

    return peak(gains, np.concatenate([[0.0], np.geomspace(1e-3, 50.0 * fastest, 1200)]))
