"""Level certified for any varying delay: one Lyapunov matrix for all delays of the task.

For the loop with u = K (roll rate) sent as v = u + e, where |e| ≤ ε |v| is what an event trigger
withholds, and the roll angle z under a held roll moment d on the body, the inequality

    x⁺'P x⁺ − x'P x + z'z − γ² d'd + λ (ε² v'v − e'e) ≤ 0

at every delay between the bounds certifies |z| ≤ γ |d| in the mean square for any sequence of
delays. It is linear in P, γ² and λ, and convex in the closed loop's matrices, which depend on the
delay only through the two columns of the hold: between delays of a dense grid they are bounded by
their neighbours. The matrices are in units in which the states are of size one; a
solver's result is evaluated here in numpy, at many more delays than it was given.
"""

from dataclasses import dataclass

import numpy as np

from gain_gen.analysis.family import Member
from gain_gen.analysis.held_plant import HeldPlant, held
from gain_gen.models.controller import Y_RATE
from gain_gen.models.roll import Matrix, stationary_covariance, zero_order_hold

FINE = 0.5e-3
"""Step of the delays at which a certificate is evaluated, s."""
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
    """

    delays: tuple[float, ...]
    a: tuple[Matrix, ...]
    b: tuple[Matrix, ...]
    z: Matrix
    v: Matrix


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
    sent = np.zeros((1, n + past))
    sent[0, :n] = gain * car.measured[Y_RATE]
    roll = np.zeros((1, n + past))
    roll[0, :n] = member.roll
    pairs = [_closed(plant, sent, disturbance, past) for plant in plants]
    # states of size one: by what a white moment and a white error bring about
    sizes = _sizes(*pairs[-1])
    kilo = np.array([1e3, 1e3])
    return SwitchedLoop(
        tuple(float(seconds) for seconds in delays),
        tuple(a * sizes[None, :] / sizes[:, None] for a, _ in pairs),
        tuple(b * kilo / sizes[:, None] for _, b in pairs),
        roll * sizes / (LEVEL_UNIT * 1e3),
        sent * sizes / 1e3,
    )


def _closed(
    plant: HeldPlant, sent: Matrix, disturbance: Matrix, past: int
) -> tuple[Matrix, Matrix]:
    """Return A, B with the last ``past`` commands as states, newest first."""
    n = len(plant.phi)
    a, b = np.zeros((n + past, n + past)), np.zeros((n + past, 2))
    a[:n, :n], b[:n, :1] = plant.phi, disturbance
    now = np.zeros(n + past)
    for column, age in ((plant.fresh, plant.steps - 1), (plant.stale, plant.steps)):
        if age <= 0:  # the command of this very tick
            a[:n] += column @ sent
            b[:n, 1:] += column
        else:
            now[:] = 0.0
            now[n + age - 1] = 1.0
            a[:n] += np.outer(column, now)
    if past:
        a[n], b[n, 1] = sent[0], 1.0
        a[n + 1 :, n : n + past - 1] = np.eye(past - 1)
    return a, b


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


def worst_eigenvalue(
    loop: SwitchedLoop, *, p: Matrix, level_squared: float, weight: float, epsilon: float
) -> float:
    """Return the largest eigenvalue of :func:`dissipation` over all delays, relative to P's."""
    largest = max(
        float(
            np.linalg.eigvalsh(
                dissipation(
                    loop, i, p=p, level_squared=level_squared, weight=weight, epsilon=epsilon
                )
            )[-1]
        )
        for i in range(len(loop.a))
    )
    return largest / float(np.linalg.eigvalsh(p)[-1])


def delay_grid(member: Member, delays: tuple[float, ...], tick: float, step: float) -> Matrix:
    """Return delays between the bounds in steps of at most ``step``, s.

    The loop's matrices have a kink at whole numbers of ticks, so these are included.
    """
    least, most = delays[0], delays[-1]
    even = np.linspace(least, most, max(int(np.ceil((most - least) / step)), 1) + 1)
    whole = np.arange(np.ceil((most - member.filtered) / tick)) * tick + member.filtered
    kinks = whole[(whole > least) & (whole < most)]
    return np.unique(np.concatenate([even, kinks]))
