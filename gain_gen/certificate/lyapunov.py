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
from gain_gen.models.state_space import Complex

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

    x⁺ = A x + B i + Σ G_j w_j with |w_j| ≤ |v_j|, v = V [x, i], and the command s = S [x, i] is
    sent. The first input e is withheld of the command; then come roundings and disturbances.

    Attributes:
        a: with every delay at the centre of its ellipsoid, (n, n).
        inputs: B, (n, m).
        bounds: of the inputs; e is besides at most a share of the command, (m,).
        places: G_j for each delay that varies, (n, r).
        jumps: V, (delays, n + m).
        sent: S, (n + m,).
        share: square of the trigger's relative threshold, or zero without a trigger.
        stored: rows of the values that the code stores, relative to their limit, (k, n).
        spread: largest part of them by roundings and disturbances themselves, (k,).
        roll: row of the roll angle, (n,).
    """

    a: Matrix
    inputs: Matrix
    bounds: Matrix
    places: tuple[Matrix, ...]
    jumps: Matrix
    sent: Matrix
    share: float
    stored: Matrix
    spread: Matrix
    roll: Matrix

    @property
    def radius(self) -> float:
        """Spectral radius with every delay at its centre."""
        return float(np.abs(np.linalg.eigvals(self.a)).max())


@dataclass(frozen=True, slots=True)
class LyapunovPoint:
    """A point of the inequality.

    Attributes:
        p: (n, n), of the ellipsoid x'Px ≤ 1.
        decay: of x'Px in a tick.
        delays: multiplier of each delay that varies.
        inputs: those of the inputs.
        roll: largest roll angle in the ellipsoid, rad.
        w: P⁻¹.
    """

    p: Matrix
    decay: float
    delays: Matrix
    inputs: Matrix
    roll: float
    w: Matrix


def fits(loop: UncertainLoop, point: LyapunovPoint) -> bool:
    """Whether no stored value reaches its limit in the ellipsoid in which the states end."""
    level = np.sqrt(point.inputs @ loop.bounds**2 / (1.0 - point.decay))
    reach = np.sqrt(np.einsum("ij,jk,ik->i", loop.stored, point.w, loop.stored))
    return bool(np.all(level * reach + loop.spread < 1.0))


def feasible(loop: UncertainLoop) -> list[LyapunovPoint]:
    """Return the points that are feasible among the tried ones, the least roll angle first."""
    gap = 1.0 - loop.radius**2
    if gap <= 0.0:
        return []
    nominal = [_nominal(loop, 1.0 - part * gap) for part in DECAYS]
    tried = [(each, share * gap) for each, share in product(nominal, SHARES)]
    points = [_point(loop, each, energy) for each, energy in tried]
    if not any(points) and len(loop.places) > (0 if loop.share else 1):
        scales = _scales(loop)
        points = [_point(loop, each, energy, scales) for each, energy in tried]
    return sorted((point for point in points if point), key=lambda point: point.roll)


def _scales(loop: UncertainLoop) -> Matrix:
    """Return the multipliers of the delays with the least gain around all inputs, (delays,).

    Relative to that of the trigger, or to the first where there is none: constant scales D of the
    structured gain (Packard and Doyle 1993), on a grid of frequencies.
    """
    b = np.hstack([loop.inputs[:, :1], *loop.places])
    c = np.vstack([np.sqrt(loop.share) * loop.sent, loop.jumps])
    of = [0, *(j + 1 for j, g in enumerate(loop.places) for _ in g.T)]
    response = responses(loop.a, b, c[:, : len(loop.a)])
    response[:, :, 0] += c[:, len(loop.a)]
    if not loop.share:
        response, of = response[:, 1:, 1:], [j - 1 for j in of[1:]]

    def gain(logarithms: Matrix) -> float:
        d = np.exp(np.concatenate([[0.0], logarithms]))
        return float(np.linalg.norm(d[:, None] * response / d[of], 2, axis=(1, 2)).max())

    free = len(loop.places) - (0 if loop.share else 1)
    least = minimize(gain, np.zeros(free), method="Nelder-Mead", options={"maxiter": 200})
    return np.asarray(np.exp(2.0 * least.x) if loop.share else np.exp(2.0 * np.r_[0.0, least.x]))


def responses(a: Matrix, b: Matrix, c: Matrix) -> Complex:
    """Return C (z − A)⁻¹ B on a grid of frequencies, (frequencies, outputs, inputs)."""
    z = np.exp(1j * np.geomspace(1e-3, np.pi, FREQUENCIES))[:, None, None]
    return np.asarray(c @ np.linalg.solve(z * np.eye(len(a)) - a, b.astype(complex)))


@dataclass(frozen=True, slots=True)
class _Nominal:
    """The ellipsoid of a decay with the delays at their centres.

    ``weights`` are the multipliers of the inputs, ``covariance`` its W, ``sizes`` of the states.
    """

    decay: float
    weights: Matrix
    covariance: Matrix
    sizes: Matrix


def _nominal(loop: UncertainLoop, decay: float) -> _Nominal:
    """Share the level out so that the sum of the inputs' ellipsoids has the least roll angle."""
    a = loop.a / np.sqrt(decay)
    driven = loop.inputs * loop.bounds
    alone = [stationary_covariance(a, np.outer(column, column)) for column in driven.T]
    reach = np.sqrt([max(float(loop.roll @ w @ loop.roll), 0.0) for w in alone])
    granted = np.maximum(reach / reach.sum(), GRANTED)
    if loop.share:
        rest = granted[1:].sum()
        granted[0] = rest * OF_TRIGGER / (1.0 - OF_TRIGGER) if rest else 1.0
    granted /= granted.sum()
    weights = (1.0 - decay) * granted / loop.bounds**2
    covariance = np.sum(
        [w / ((1.0 - decay) * g) for w, g in zip(alone, granted, strict=True)], axis=0
    )
    sizes = np.sqrt(np.diag(covariance))
    return _Nominal(decay, weights, covariance, np.where(sizes > 0.0, sizes, 1.0))


def _point(
    loop: UncertainLoop, nominal: _Nominal, energy: float, scales: Matrix | None = None
) -> LyapunovPoint | None:
    n, weights = len(loop.a), nominal.weights
    jumps = np.einsum("ij,jk,ik->i", loop.jumps[:, :n], nominal.covariance, loop.jumps[:, :n])
    delays = energy / (jumps + (loop.jumps[:, n:] ** 2 @ loop.bounds**2))
    if scales is not None:
        delays = scales * (weights[0] if loop.share else delays.mean() / scales.mean())
    return solved(loop, nominal.decay, delays, weights, nominal.sizes)


def solved(
    loop: UncertainLoop,
    decay: float,
    delays: Matrix,
    weights: Matrix,
    sizes: Matrix,
    *,
    performance: float = 0.0,
) -> LyapunovPoint | None:
    """Return the point of the least ellipsoid for given multipliers, or None.

    Args:
        loop: of the inequality.
        decay: of x'Px in a tick.
        delays: multipliers of the delays that vary.
        weights: multipliers of the inputs.
        sizes: of the states.
        performance: factor on the square of the roll angle that x'Px loses besides.
    """
    n = len(loop.a)
    b = np.hstack(
        [
            loop.inputs / np.sqrt(weights),
            *(g / np.sqrt(d) for g, d in zip(loop.places, delays, strict=True)),
        ]
    )
    b = b * np.sqrt(1.0 + 2.0 * SLACK) / sizes[:, None]
    roll = np.concatenate([loop.roll, np.zeros(len(weights))])
    c = np.vstack(
        [
            np.sqrt(ROOM * delays)[:, None] * loop.jumps,
            np.sqrt(weights[0] * loop.share) * loop.sent,
            np.sqrt(performance) * roll,
        ]
    )
    d = np.zeros((len(c), b.shape[1]))
    d[:, : len(weights)] = c[:, n:] / np.sqrt(weights)
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
    reach = float(np.sqrt((loop.roll * sizes) @ w @ (loop.roll * sizes)))
    return LyapunovPoint(p, decay, delays, weights, reach, w * np.outer(sizes, sizes))
