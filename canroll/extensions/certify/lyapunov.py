"""Lyapunov matrix and multipliers of a claim in floating point; only the checker judges them.

With the places w of the delays, the withheld part of a command and the roundings as inputs, and
the jumps of the command as outputs, each scaled by its multiplier, the inequality of the checker is
that of the bounded real lemma. Its dual Riccati equation

    W = A W A' + B B' + (A W C' + B D') (1 − D D' − C W C')⁻¹ (A W C' + B D')'

with A and C divided by the root of the decay has the least W = P⁻¹, so the least ellipsoid
(Boyd et al. 1994, chapters 5 and 6). The decay and the energy granted to the jumps are searched.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from canroll.extensions.certify.responses import balanced
from canroll.extensions.certify.uncertain_loop import Trigger, UncertainLoop
from canroll.gain_gen.models.roll import Matrix, stationary_covariance

SLACK = 1e-5
"""Relative room in x'Px for what leaves the ellipsoids of the delays."""
ROOM = 1.005
"""Factor on the energy of the jumps for the same."""
CLEARANCE = 1e-5
"""Added to W's right-hand side, relative to the states' sizes: the inequality becomes strict."""
DOUBLINGS = 40
"""Of the ticks in which W is summed."""
EXACT = 1e-14
"""Change of W by the last of them, relative."""
DECAYS = (0.8, 0.6, 0.4, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
"""Tried 1 − decay, relative to that of the loop with the middle delays."""
SHARES = (0.1, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0)
"""Tried energies of the jumps in a tick, relative to what the loop loses in it."""
OF_TRIGGER = 0.9
"""Part of the level granted to what the trigger withholds."""
GRANTED = 1e-3
"""Least part of the level granted to a rounding."""


@dataclass(frozen=True, slots=True)
class LyapunovPoint:
    """A point of the inequality.

    Attributes:
        p: (n, n), of the ellipsoid x'Px ≤ 1.
        decay: of x'Px in a tick.
        delays: multiplier of each delay that varies.
        inputs: those of the inputs.
        switching: of the trigger, with its sign: sent or held.
        roll: largest roll angle in the ellipsoid, rad.
        w: P⁻¹.
        limit: multipliers of the limit of moment; None where it does not act.
    """

    p: Matrix
    decay: float
    delays: Matrix
    inputs: Matrix
    switching: float
    roll: float
    w: Matrix
    limit: Matrix | None = None


def fits(loop: UncertainLoop, point: LyapunovPoint) -> bool:
    """Whether no stored value reaches its limit in the ellipsoid in which the states end."""
    level = np.sqrt(point.inputs @ loop.bounds**2 / (1.0 - point.decay))
    reach = np.sqrt(np.einsum("ij,jk,ik->i", loop.stored, point.w, loop.stored))
    return bool(np.all(level * reach + loop.spread < 1.0))


def feasible(loop: UncertainLoop) -> list[LyapunovPoint]:
    """Return the points that are feasible among the tried ones, the least roll angle first."""
    points = _withheld(loop, loop.trigger) if loop.trigger else _every_tick(loop)
    return sorted((point for point in points if point), key=lambda point: point.roll)


def _every_tick(loop: UncertainLoop) -> list[LyapunovPoint | None]:
    """Return points with several energies of the jumps, shared evenly or else by their balance."""
    tried = [(each, share) for each, share in product(_nominals(loop), SHARES)]
    points = [_point(loop, each, share) for each, share in tried]
    if tried and not any(points) and len(loop.places) > 1:
        scales = balanced(loop).scales
        points = [_point(loop, each, share, scales) for each, share in tried]
    return points


def _withheld(loop: UncertainLoop, trigger: Trigger) -> Iterator[LyapunovPoint | None]:
    """Yield points with the multipliers of the delays relative to that of the trigger."""
    balance = balanced(loop)
    centred = loop.centred(balance.kappa)
    for each in _nominals(centred):
        delays = balance.scales[1:] * each.weights[0]
        point = solved(centred, each.decay, delays, each.weights, each.sizes)
        yield point and uncentred(point, trigger, balance.kappa)


def uncentred(point: LyapunovPoint, trigger: Trigger, kappa: float) -> LyapunovPoint:
    """Return a point of a loop that was centred with κ as one of the loop as it is."""
    weight = point.inputs[0] / trigger.curvature(kappa)
    return replace(point, inputs=np.r_[weight, point.inputs[1:]], switching=float(kappa * weight))


@dataclass(frozen=True, slots=True)
class _Nominal:
    """The ellipsoid of a decay with the delays at their centres.

    ``weights`` are the multipliers of the inputs, ``covariance`` its W, ``sizes`` of the states.
    """

    decay: float
    weights: Matrix
    covariance: Matrix
    sizes: Matrix


def _nominals(loop: UncertainLoop) -> list[_Nominal]:
    """Return one for each of the tried decays; none of an unstable loop."""
    gap = 1.0 - loop.radius**2
    return [nominal(loop, 1.0 - part * gap) for part in DECAYS] if gap > 0.0 else []


def nominal(loop: UncertainLoop, decay: float) -> _Nominal:
    """Share the level out so that the sum of the inputs' ellipsoids has the least roll angle."""
    a = loop.a / np.sqrt(decay)
    driven = loop.inputs * loop.bounds
    alone = [stationary_covariance(a, np.outer(column, column)) for column in driven.T]
    reach = np.sqrt([max(float(loop.roll @ w @ loop.roll), 0.0) for w in alone])
    granted = np.maximum(reach / reach.sum(), GRANTED)
    if len(loop.withheld):
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
    loop: UncertainLoop, nominal: _Nominal, share: float, scales: Matrix | None = None
) -> LyapunovPoint | None:
    n = len(loop.a)
    jumps = np.einsum("ij,jk,ik->i", loop.jumps[:, :n], nominal.covariance, loop.jumps[:, :n])
    energy = share * (1.0 - loop.radius**2)
    delays = energy / (jumps + (loop.jumps[:, n:] ** 2 @ loop.bounds**2))
    if scales is not None:
        delays = scales * (delays.mean() / scales.mean())
    return solved(loop, nominal.decay, delays, nominal.weights, nominal.sizes)


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
            np.sqrt(weights[0]) * loop.withheld,
            np.sqrt(performance) * roll,
        ]
    )
    d = np.zeros((len(c), b.shape[1]))
    d[:, : len(weights)] = c[:, n:] / np.sqrt(weights)
    c = c[:, :n] * sizes / np.sqrt(decay)
    a = loop.a * np.sqrt((1.0 + 2.0 * SLACK) / decay) * sizes / sizes[:, None]
    try:
        w = _least(a, b, c, d)
        p = None if w is None else np.linalg.inv(w)
    except np.linalg.LinAlgError:
        return None
    if w is None or p is None:
        return None
    p = 0.5 * (p + p.T) / np.outer(sizes, sizes)
    reach = float(np.sqrt((loop.roll * sizes) @ w @ (loop.roll * sizes)))
    return LyapunovPoint(p, decay, delays, weights, 0.0, reach, w * np.outer(sizes, sizes))


def _least(a: Matrix, b: Matrix, c: Matrix, d: Matrix) -> Matrix | None:
    """Return the least W of the dual Riccati equation, by doubling (Chu et al. 2004), or None."""
    identity, rest = np.eye(len(a)), np.eye(len(d)) - d @ d.T
    if not np.linalg.eigvalsh(rest)[0] > 0.0:
        return None
    # what is common to B and D acts as feedback
    fed = b @ np.linalg.solve(rest, d).T
    step, g = (a + fed @ c).T, -c.T @ np.linalg.solve(rest, c)
    w = b @ b.T + fed @ d @ b.T + CLEARANCE * identity
    for _ in range(DOUBLINGS):
        if not np.linalg.eigvalsh(rest - c @ w @ c.T)[0] > 0.0:
            return None
        inverse = np.linalg.inv(identity + g @ w)
        more, onward = step.T @ w @ inverse @ step, step @ inverse
        w, g, step = w + 0.5 * (more + more.T), g + onward @ g @ step.T, onward @ step
        if np.abs(more).max() <= EXACT * np.abs(w).max():
            return w if np.linalg.eigvalsh(w)[0] > 0.0 else None
    return None
