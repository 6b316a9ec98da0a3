"""Where a delay takes the car's state: a curve in a small ellipsoid, in floating point.

A command that takes effect at the instant s of a tick lacks F(s) = ∫₀ˢ exp(A (T − r)) B dr of what
it would have brought about from the start of the tick. The curve F is almost straight.
"""

from dataclasses import dataclass

import numpy as np

from canroll.gain_gen.models.roll import Matrix, zero_order_hold

POINTS = 65
RANK = 5
"""Generators of an ellipsoid: along the curve, its bow, its twist, and so on."""
THIN = 1e-8
"""Extent of the curve, relative to its greatest, that the remainder covers as well."""
ITERATIONS = 200
ENLARGED = 1.01


def lacking(a: Matrix, b: Matrix, tick: float, instants: Matrix) -> Matrix:
    """Return F at every instant, (instants, n); ``a`` (n, n), ``b`` (n,), seconds."""

    def held(seconds: float) -> Matrix:
        return zero_order_hold(a, b[:, None], seconds)[1][:, 0]

    # a state that no command reaches would be rounding noise, of which an ellipsoid makes a size
    reached = b != 0.0
    for _ in b:
        reached = reached | ((a != 0.0) @ reached)
    curve: Matrix = np.array([held(tick) - held(tick - s) for s in instants]) * reached
    return curve


@dataclass(frozen=True, slots=True)
class Ellipsoid:
    """{c + G w, |w| ≤ 1} nearly about a curve.

    Attributes:
        centre: c, (n,).
        generators: G, (n, r).
        onto: (r, n), the place w of a point x is onto (x − c).
    """

    centre: Matrix
    generators: Matrix
    onto: Matrix


def ellipsoid(curve: Matrix) -> Ellipsoid:
    """Return a small ellipsoid about a curve, (points, n)."""
    sizes = np.abs(curve).max(axis=0)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    middle = curve.mean(axis=0)
    scaled = (curve - middle) / sizes
    _, reach, axes = np.linalg.svd(scaled, full_matrices=False)
    axes = axes[:RANK][reach[:RANK] > THIN * reach[0]]
    centre, shape = _least_ellipsoid(scaled @ axes.T)
    return Ellipsoid(
        middle + sizes * (centre @ axes),
        sizes[:, None] * (axes.T @ shape),
        np.linalg.solve(shape, axes / sizes),
    )


def _least_ellipsoid(points: Matrix) -> tuple[Matrix, Matrix]:
    """Return c and L of nearly the least {c + L w, |w| ≤ 1} about points (Khachiyan 1996)."""
    count, dimension = points.shape
    units = np.abs(points).max(axis=0)
    lifted = np.hstack([points / units, np.ones((count, 1))])
    weight = np.full(count, 1.0 / count)
    for _ in range(ITERATIONS):
        inverse = np.linalg.inv(lifted.T @ (weight[:, None] * lifted))
        weight *= np.einsum("ij,jk,ik->i", lifted, inverse, lifted) / (dimension + 1.0)
    centre = weight @ lifted[:, :dimension]
    off = lifted[:, :dimension] - centre
    root = np.linalg.cholesky(off.T @ (weight[:, None] * off))
    reach = np.linalg.norm(np.linalg.solve(root, off.T), axis=0).max()
    return units * centre, ENLARGED * reach * units[:, None] * root
