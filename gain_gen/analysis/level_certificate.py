"""Level certified for any varying delay: one Lyapunov matrix for all delays of the task.

For the loop with u = K (roll rate) sent as v = u + e, where |e| ≤ ε |v| is what an event trigger
withholds, and the roll angle z under a held roll moment d on the body, the inequality

    x⁺'P x⁺ − x'P x + z'z − γ² d'd + λ (ε² v'v − e'e) ≤ 0

at every delay between the bounds certifies |z| ≤ γ |d| in the mean square for any sequence of
delays. It is linear in P, γ² and λ. A solver's result, at a few delays, is evaluated here in numpy
at many; between two of them the matrix is bounded by those at both and by its curvature, see
:func:`bound_over_delays`. The matrices are in units in which the states are of size one.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import exp

import numpy as np
from scipy.linalg import eigh

from canroll.gain_gen.analysis.actuated_car import ActuatedCar
from canroll.gain_gen.analysis.family import Member
from canroll.gain_gen.analysis.held_plant import HeldPlant, held, padded
from canroll.gain_gen.models.controller import Y_RATE
from canroll.gain_gen.models.roll import Matrix, stationary_covariance, zero_order_hold

LARGEST_EXPONENT = 300.0
"""Growth within a step of the delays beyond which nothing is certified anyway."""
LEVEL_UNIT = np.pi / 180.0 / 1e3
"""One degree per kN·m: the unit in which levels are near one."""


@dataclass(frozen=True, slots=True)
class SwitchedLoop:
    """The closed loop at each of several delays on one state [plant, past commands].

    x⁺ = A x + B [d, e], z = C x; v = K x + e is sent.

    Attributes:
        delays: s.
        a: (n, n) for each.
        b: (n, 2) for each.
        z: (1, n), roll in :data:`LEVEL_UNIT`.
        v: (1, n), K.
        curvature: second derivative of [A, B] by the delay, just below each delay, (n, n + 2).
        flow: the continuous plant's matrix in the same units, on the first states, (m, m).
    """

    delays: tuple[float, ...]
    a: tuple[Matrix, ...]
    b: tuple[Matrix, ...]
    z: Matrix
    v: Matrix
    curvature: tuple[Matrix, ...]
    flow: Matrix


def switched_loop(member: Member, gain: float, delays: Matrix, tick: float) -> SwitchedLoop:
    """Return the loop of u = ``gain`` · roll rate on ``member`` at every delay.

    Args:
        member: of a family.
        gain: roll-rate gain, N·m·s/rad.
        delays: from motion to force, s, ascending.
        tick: s.
    """
    car = member.plant
    plants = [
        held(car.a, car.command, tick=tick, delay=max(float(seconds) - member.filtered, 0.0))
        for seconds in delays
    ]
    disturbance = zero_order_hold(car.a, car.disturbance, tick)[1]
    past, n = max(plant.steps for plant in plants), len(car.a)
    sent = padded(gain * car.measured[[Y_RATE]], n + past)
    roll = padded(member.roll[None, :], n + past)
    pairs = [_closed(plant, sent, disturbance, past) for plant in plants]
    # states of size one: by what a white moment and a white error bring about
    sizes = _sizes(*pairs[-1])
    kilo = np.array([1e3, 1e3])
    curved = [_curvature(plant, car, sent, past) for plant in plants]
    return SwitchedLoop(
        tuple(float(seconds) for seconds in delays),
        tuple(a * sizes[None, :] / sizes[:, None] for a, _ in pairs),
        tuple(b * kilo / sizes[:, None] for _, b in pairs),
        roll * sizes / (LEVEL_UNIT * 1e3),
        sent * sizes / 1e3,
        tuple(matrix * np.concatenate([sizes, kilo]) / sizes[:, None] for matrix in curved),
        car.a * sizes[None, :n] / sizes[:n, None],
    )


def _closed(
    plant: HeldPlant, sent: Matrix, disturbance: Matrix, past: int
) -> tuple[Matrix, Matrix]:
    """Return A, B with the last ``past`` commands as states, the oldest first."""
    line, entry = plant.delayed(past)
    return line + entry @ sent, np.hstack([padded(disturbance.T, len(line)).T, entry])


def _curvature(plant: HeldPlant, car: ActuatedCar, sent: Matrix, past: int) -> Matrix:
    """Return the second derivative of [A, B] by the delay; see :func:`_closed`.

    With τ the time into the tick at which the command changes, the hold's newer column is
    Γ = ∫ e^{As} ds B over T − τ; then Γ'' = A e^{A (T − τ)} B = A (A Γ + B). The older column's is
    the opposite.
    """
    n = len(car.a)
    bend = car.a @ (car.a @ plant.fresh + car.command)
    turned = replace(plant, phi=np.zeros_like(car.a), fresh=bend, stale=-bend)
    matrix = np.hstack(_closed(turned, sent, np.zeros((n, 1)), past))
    matrix[n:] = 0.0
    return matrix


def _sizes(a: Matrix, b: Matrix) -> Matrix:
    """Return a typical size of each state under white inputs of 1 kN·m."""
    covariance = stationary_covariance(a, 1e6 * b @ b.T)
    deviations = np.sqrt(np.diag(covariance))
    return np.asarray(np.where(deviations > 0.0, deviations, 1.0))


def dissipation(
    loop: SwitchedLoop,
    index: int,
    *,
    p: Matrix,
    level_squared: float,
    weight: float,
    epsilon: float,
) -> Matrix:
    """Return the inequality's matrix at one delay; it holds where this is negative definite.

    Args:
        loop: in its units.
        index: of the delay.
        p: Lyapunov matrix, (n, n).
        level_squared: γ².
        weight: λ, not negative.
        epsilon: relative threshold of the trigger; zero leaves the error out.
    """
    a, b = loop.a[index], loop.b[index]
    n = len(a)
    if not epsilon:
        joint = np.hstack([a, b[:, :1]])
        cost = np.diag(np.r_[np.zeros(n), -level_squared])
    else:
        joint = np.hstack([a, b])
        sent = np.hstack([loop.v, [[0.0, 1.0]]])
        cost = weight * epsilon**2 * sent.T @ sent
        cost += np.diag(np.r_[np.zeros(n), -level_squared, -weight])
    matrix = joint.T @ p @ joint + cost
    matrix[:n, :n] += loop.z.T @ loop.z - p
    return np.asarray(0.5 * (matrix + matrix.T))


def bound_over_delays(
    loop: SwitchedLoop, *, p: Matrix, level_squared: float, weight: float, epsilon: float
) -> tuple[float, float]:
    """Return the largest eigenvalue of :func:`dissipation` at the delays and a bound between them.

    With J = [A, B] the matrix is JᵀP J and a constant. By the delay −(JᵀP J)'' is at most
    −J''ᵀP J − JᵀP J'', for J'ᵀP J' ≥ 0: between two delays Δ apart the matrix is at most what is
    linear between them and Δ²/4 |J''| |J| (error of linear interpolation, norms by P), where |J| is
    at most that of either end and Δ²/8 |J''|. J'' below a delay follows from that at it by the
    plant's flow, which grows at most with its logarithmic norm (Dahlquist 1958).

    Args:
        loop: at delays that include all kinks, :func:`delay_grid`.
        p: Lyapunov matrix, (n, n), positive definite.
        level_squared: γ².
        weight: λ.
        epsilon: relative threshold of the trigger.

    Returns:
        Largest at the delays, and bound at and between them, relative to P's largest.
    """
    n, inputs = len(p), 2 if epsilon else 1
    root = np.linalg.cholesky(p).T
    largest = float(np.linalg.eigvalsh(p)[-1])
    at = [
        float(np.linalg.eigvalsh(matrix)[-1])
        for matrix in (
            dissipation(loop, i, p=p, level_squared=level_squared, weight=weight, epsilon=epsilon)
            for i in range(len(loop.a))
        )
    ]
    size = [
        float(np.linalg.norm(root @ np.hstack([a, b[:, :inputs]]), 2))
        for a, b in zip(loop.a, loop.b, strict=True)
    ]
    bend = [float(np.linalg.norm(root @ matrix[:, : n + inputs], 2)) for matrix in loop.curvature]
    plant = p[: len(loop.flow), : len(loop.flow)]
    speed = float(eigh(plant @ loop.flow + loop.flow.T @ plant, plant, eigvals_only=True)[-1])
    bound = max(at)
    for i, (least, most) in enumerate(pairwise(loop.delays)):
        step = most - least
        curve = bend[i + 1] * exp(min(0.5 * max(speed, 0.0) * step, LARGEST_EXPONENT))
        reach = max(size[i], size[i + 1]) + step**2 / 8.0 * curve
        bound = max(bound, max(at[i], at[i + 1]) + step**2 / 4.0 * curve * reach)
    return max(at) / largest, bound / largest


def delay_grid(member: Member, delays: tuple[float, ...], tick: float, step: float) -> Matrix:
    """Return delays between the bounds in steps of at most ``step``, s.

    The loop's matrices have a kink at whole numbers of ticks, so these are included.
    """
    least, most = delays[0], delays[-1]
    even = np.linspace(least, most, max(int(np.ceil((most - least) / step)), 1) + 1)
    multiples = np.arange(np.ceil((most - member.filtered) / tick)) * tick + member.filtered
    kinks = multiples[(multiples > least) & (multiples < most)]
    return np.unique(np.concatenate([even, kinks]))
