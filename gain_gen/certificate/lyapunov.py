"""Lyapunov matrix and multipliers of a claim in floating point; only the checker judges them.

With the places w of the delays, the withheld part e of a command and the roundings as inputs, and
the jumps of the command as outputs, each scaled by its multiplier, the inequality of the checker is
that of the bounded real lemma. Its dual Riccati equation

    W = A W A' + B B' + (A W C' + B D') (1 − D D' − C W C')⁻¹ (A W C' + B D')'

with A and C divided by the root of the decay has the least W = P⁻¹, so the least ellipsoid
(Boyd et al. 1994, chapters 5 and 6). The decay and the energy granted to the jumps are searched.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize

from gain_gen.models.roll import Matrix, stationary_covariance

SLACK = 3e-5
"""Relative room in x'Px for what leaves the ellipsoids of the delays."""
ROOM = 1.05
"""Factor on the energy of the jumps for the same."""
CLEARANCE = 1e-5
"""Added to W's right-hand side, relative to the states' sizes: the inequality becomes strict."""
DECAYS = (0.8, 0.6, 0.4, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
"""Tried 1 − decay, relative to that of the loop with the middle delays."""
SHARES = (0.1, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0)
"""Tried energies of the jumps in a tick, relative to what the loop loses in it."""
OF_TRIGGER = 0.9
"""Part of the level granted to what the trigger withholds."""
GRANTED = 1e-3
"""Least part of the level granted to a rounding."""

FREQUENCIES = 80
"""Of the grid on which the multipliers are balanced."""


@dataclass(frozen=True, slots=True)
class UncertainLoop:
    """The sampled loop with its inputs; commands in N·m, Q14, roundings in the ECU's units.

    x⁺ = A x + B e + Σ G_j w_j + n with |w_j| ≤ |v_j|, v = V [x, e], and the command s = S [x, e]
    is sent.

    Attributes:
        a: with every delay at the centre of its ellipsoid, (n, n).
        withheld: B, (n,).
        places: G_j for each delay that varies, (n, r).
        jumps: V, (delays, n + 1).
        sent: S, (n + 1,).
        share: square of the trigger's relative threshold, or zero without a trigger.
        floor: largest e besides that.
        roundings: largest n of the last states, (m,).
        roll: row of the roll angle, (n,).
    """

    a: Matrix
    withheld: Matrix
    places: tuple[Matrix, ...]
    jumps: Matrix
    sent: Matrix
    share: float
    floor: float
    roundings: Matrix
    roll: Matrix

    @property
    def radius(self) -> float:
        """Spectral radius with every delay at its centre."""
        return float(np.abs(np.linalg.eigvals(self.a)).max())


@dataclass(frozen=True, slots=True)
class Point:
    """A point of the inequality.

    Attributes:
        p: (n, n), of the ellipsoid x'Px ≤ 1.
        decay: of x'Px in a tick.
        delays: multiplier of each delay.
        withheld: that of e.
        roundings: those of the roundings.
        roll: largest roll angle in the ellipsoid, rad.
    """

    p: Matrix
    decay: float
    delays: Matrix
    withheld: float
    roundings: Matrix
    roll: float


def feasible(loop: UncertainLoop) -> list[Point]:
    """Return the points that are feasible among the tried ones, the least roll angle first."""
    gap = 1.0 - loop.radius**2
    if gap <= 0.0:
        return []
    nominal = [_nominal(loop, 1.0 - part * gap) for part in DECAYS]
    tried = [(each, share * gap) for each, share in product(nominal, SHARES)]
    points = [_point(loop, each, energy) for each, energy in tried]
    if not any(points) and len(loop.places):
        scales = _scales(loop)
        points = [_point(loop, each, energy, scales) for each, energy in tried]
    return sorted((point for point in points if point), key=lambda point: point.roll)


def _scales(loop: UncertainLoop) -> Matrix:
    """Return the multipliers of the delays with the least gain around all inputs, (delays,).

    Relative to that of the trigger, or to the first where there is none: constant scales D of the
    structured gain (Packard and Doyle 1993), on a grid of frequencies.
    """
    n = len(loop.a)
    b = np.hstack([loop.withheld[:, None], *loop.places])
    c = np.vstack([np.sqrt(loop.share) * loop.sent, loop.jumps])
    of = [0, *(j + 1 for j, g in enumerate(loop.places) for _ in g.T)]
    z = np.exp(1j * np.geomspace(1e-3, np.pi, FREQUENCIES))
    response = c[:, :n] @ np.linalg.solve(z[:, None, None] * np.eye(n) - loop.a, b.astype(complex))
    response[:, :, 0] += c[:, n]
    if not loop.share:
        response, of = response[:, 1:, 1:], [j - 1 for j in of[1:]]

    def gain(logarithms: Matrix) -> float:
        d = np.exp(np.concatenate([[0.0], logarithms]))
        return float(np.linalg.norm(d[:, None] * response / d[of], 2, axis=(1, 2)).max())

    free = len(loop.places) - (0 if loop.share else 1)
    least = minimize(gain, np.zeros(free), method="Nelder-Mead", options={"maxiter": 200})
    return np.asarray(np.exp(2.0 * least.x) if loop.share else np.exp(2.0 * np.r_[0.0, least.x]))


@dataclass(frozen=True, slots=True)
class _Nominal:
    """The ellipsoid of a decay with the delays at their centres.

    ``weights`` are the multipliers of e and the roundings, ``covariance`` its W, ``sizes`` of the
    states.
    """

    decay: float
    weights: Matrix
    covariance: Matrix
    sizes: Matrix


def _nominal(loop: UncertainLoop, decay: float) -> _Nominal:
    """Share the level out so that the sum of the inputs' ellipsoids has the least roll angle."""
    n, noisy = len(loop.a), len(loop.roundings)
    a = loop.a / np.sqrt(decay)
    inputs = np.zeros((n, 1 + noisy))
    inputs[:, 0] = loop.floor * loop.withheld
    inputs[n - noisy :, 1:] = np.diag(loop.roundings)
    alone = [stationary_covariance(a, np.outer(column, column)) for column in inputs.T]
    reach = np.sqrt([max(float(loop.roll @ w @ loop.roll), 0.0) for w in alone])
    granted = np.maximum(reach / reach.sum(), GRANTED)
    if loop.share:
        granted[0] = granted[1:].sum() * OF_TRIGGER / (1.0 - OF_TRIGGER) if noisy else 1.0
    granted /= granted.sum()
    weights = (1.0 - decay) * granted / np.r_[loop.floor, loop.roundings] ** 2
    covariance = np.sum(
        [w / ((1.0 - decay) * g) for w, g in zip(alone, granted, strict=True)], axis=0
    )
    sizes = np.sqrt(np.diag(covariance))
    return _Nominal(decay, weights, covariance, np.where(sizes > 0.0, sizes, 1.0))


def _point(
    loop: UncertainLoop, nominal: _Nominal, energy: float, scales: Matrix | None = None
) -> Point | None:
    n, noisy = len(loop.a), len(loop.roundings)
    decay, weights, sizes = nominal.decay, nominal.weights, nominal.sizes
    jumps = np.einsum("ij,jk,ik->i", loop.jumps[:, :n], nominal.covariance, loop.jumps[:, :n])
    delays = energy / (jumps + (loop.floor * loop.jumps[:, n]) ** 2)
    if scales is not None:
        delays = scales * (weights[0] if loop.share else delays.mean() / scales.mean())
    b = np.hstack(
        [
            loop.withheld[:, None] / np.sqrt(weights[0]),
            *(g / np.sqrt(d) for g, d in zip(loop.places, delays, strict=True)),
            np.eye(n)[:, n - noisy :] / np.sqrt(weights[1:]),
        ]
    )
    b = b * np.sqrt(1.0 + 2.0 * SLACK) / sizes[:, None]
    c = np.vstack(
        [np.sqrt(ROOM * delays)[:, None] * loop.jumps, np.sqrt(weights[0] * loop.share) * loop.sent]
    )
    d = np.zeros((len(c), b.shape[1]))
    d[:, 0] = c[:, n] / np.sqrt(weights[0])
    c = c[:, :n] * sizes / np.sqrt(decay)
    a = loop.a * np.sqrt((1.0 + 2.0 * SLACK) / decay) * sizes / sizes[:, None]
    driven = b @ b.T + CLEARANCE * np.eye(n)
    try:
        w = solve_discrete_are(a.T, c.T, driven, d @ d.T - np.eye(len(c)), s=b @ d.T)
        p = np.linalg.inv(0.5 * (w + w.T))
    except np.linalg.LinAlgError:
        return None
    if not np.linalg.eigvalsh(np.eye(len(c)) - d @ d.T - c @ w @ c.T)[0] > 0.0:
        return None
    if not np.linalg.eigvalsh(w)[0] > 0.0:
        return None
    p = 0.5 * (p + p.T) / np.outer(sizes, sizes)
    roll = float(np.sqrt((loop.roll * sizes) @ w @ (loop.roll * sizes)))
    return Point(p, decay, delays, float(weights[0]), weights[1:], roll)
