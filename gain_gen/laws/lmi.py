"""Least cost under matrix inequalities, which are the functions of the certificates themselves.

A program is a function from its unknowns to matrices that must be negative definite, affine in all
of them; the solver gets its coefficients by unit values. Everything is in the units of
:class:`canroll.gain_gen.models.roll.NormalisedPlant`, or of the loop: in N·m the solvers report
wrong optima. This module alone imports cvxpy, which takes half a second.
"""

import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import cvxpy as cp
import numpy as np

from canroll.gain_gen.analysis.certificates import (
    CertifiedPlant,
    discrete_block,
    event_block,
)
from canroll.gain_gen.analysis.level_certificate import SwitchedLoop, dissipation
from canroll.gain_gen.models.roll import Matrix

SOLVER = "CLARABEL"
STRICT = 1e-6
"""Margin by which every inequality must be inside the cone."""
LEVEL_STRICT = 1e-5
"""The same for the level certificate."""
SCALAR, NONNEG = "scalar", "nonneg"
Unknown = str | int | tuple[int, int]
"""A number, one that is not negative, the size of a symmetric matrix, or the shape of another."""


@dataclass(slots=True)
class Clock:
    """Time spent in solvers, s, and number of calls."""

    seconds: float = 0.0
    solves: int = 0


def _units(unknown: Unknown) -> Iterator[Any]:
    """Yield the unit values of an unknown."""
    if isinstance(unknown, str):
        yield 1.0
        return
    symmetric = isinstance(unknown, int)
    rows, columns = (unknown, unknown) if isinstance(unknown, int) else unknown
    for i in range(rows):
        for j in range(i if symmetric else 0, columns):
            unit = np.zeros((rows, columns))
            unit[i, j] = 1.0
            yield np.maximum(unit, unit.T) if symmetric else unit


@lru_cache(maxsize=16)
def _program(sizes: tuple[int, ...], kinds: tuple[bool, ...], strict: float) -> tuple[Any, ...]:
    """Problem, unknowns and parameters: compiled once for all of these sizes."""
    v = cp.Variable(len(kinds))
    rows = [(cp.Parameter((n * n, len(kinds))), cp.Parameter(n * n)) for n in sizes]
    constraints = [v[i] >= 0 for i, nonneg in enumerate(kinds) if nonneg]
    constraints += [
        cp.reshape(by @ v + constant, (n, n), order="F") << -strict * np.eye(n)
        for n, (by, constant) in zip(sizes, rows, strict=True)
    ]
    return cp.Problem(cp.Minimize(v[0]), constraints), v, rows


def minimise(
    forms: Callable[..., Sequence[Matrix]],
    unknowns: Mapping[str, Unknown],
    clock: Clock,
    strict: float = STRICT,
) -> dict[str, Any] | None:
    """Return the unknowns with the least first one for which all forms are negative, or None.

    Inaccurate optima are returned too: the caller verifies.
    """
    units = [(name, unit) for name, kind in unknowns.items() for unit in _units(kind)]
    nothing = {name: 0.0 * next(_units(kind)) for name, kind in unknowns.items()}

    def flat(**changed: Any) -> list[Matrix]:  # noqa: ANN401
        return [0.5 * (form + form.T).ravel() for form in forms(**(nothing | changed))]

    base = flat()
    probed = [flat(**{name: unit}) for name, unit in units]
    sizes = tuple(round(len(form) ** 0.5) for form in base)
    problem, v, rows = _program(sizes, tuple(unknowns[n] == NONNEG for n, _ in units), strict)
    for k, (by, constant) in enumerate(rows):
        by.value = np.array([each[k] - base[k] for each in probed]).T
        constant.value = base[k]
    started = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            problem.solve(solver=SOLVER)
    except cp.error.SolverError:
        return None
    finally:
        clock.seconds += time.perf_counter() - started
        clock.solves += 1
    if problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
        return None
    found = dict(nothing)
    for (name, unit), value in zip(units, np.asarray(v.value), strict=True):
        found[name] = found[name] + float(value) * unit
    return found


class EventPoint(NamedTuple):
    """Lyapunov–Krasovskii certificate of an event-triggered loop: level, P (2, 2) and weights.

    ``r`` of the delay term, ``omega`` of the trigger, ``s`` of the delayed output, zero for a
    sampled or varying delay.
    """

    gamma_squared: float
    p: Matrix
    r: float
    omega: float
    s: float = 0.0


class DiscretePoint(NamedTuple):
    """Discrete H∞ state feedback, scaled: level χ, P (n, n), Y (m, n)."""

    chi: float
    p: Matrix
    y: Matrix


class LevelPoint(NamedTuple):
    """Level of a switched loop: γ² in its unit, P (n, n) and the error's weight λ."""

    level_squared: float
    p: Matrix
    weight: float


def event_point(
    plant: CertifiedPlant, gain: float, delay: float, epsilon_squared: float, clock: Clock
) -> EventPoint | None:
    """Return the best certificate of the event-triggered delay loop at a gain, or None.

    The 2022 paper prints no inequality; S = 0, so the delay may vary.
    """

    def forms(p: Matrix, **weights: float) -> Sequence[Matrix]:
        at = {"gain": gain, "delay": delay, "epsilon_squared": epsilon_squared}
        return event_block(plant, p=p, s=0.0, **weights, **at), -p

    unknowns: dict[str, Unknown] = {"gamma_squared": NONNEG, "p": 2, "r": NONNEG, "omega": NONNEG}
    found = minimise(forms, unknowns, clock)
    return None if found is None else EventPoint(**found)


def fixed_lyapunov_certificate(
    block: Callable[..., Matrix], p: Matrix, gain: float, clock: Clock
) -> EventPoint | None:
    """Return the best R, S, Ω and level for a given P, or None if infeasible.

    Args:
        block: the inequality as function of p, r, s, omega, gamma_squared; affine in them.
        p: P as printed, (2, 2).
        gain: N·m·s/rad, by which q and e are scaled.
        clock: accumulates the time in solvers.
    """
    scale, unit = np.diag([1.0, 1.0, abs(gain), abs(gain), 1.0, 1.0, 1.0]), gain**-2

    def forms(gamma_squared: float, **weights: float) -> Sequence[Matrix]:
        scaled = {name: unit * weight for name, weight in weights.items()}
        return (scale @ block(p=p, gamma_squared=gamma_squared, **scaled) @ scale,)

    found = minimise(forms, dict.fromkeys(("gamma_squared", "r", "s", "omega"), NONNEG), clock)
    if found is None:
        return None
    return EventPoint(found.pop("gamma_squared"), p, **{k: unit * v for k, v in found.items()})


def discrete_h_infinity(
    phi: Matrix, gamma: Matrix, pi: Matrix, *, c: Matrix, d: Matrix, clock: Clock
) -> DiscretePoint | None:
    """Return the optimum of Yim 2020, (12), on scaled matrices, or None.

    u = Y P⁻¹ x, z = C x + D u, w one disturbance.
    """
    n, m = gamma.shape

    # without the margin of the others: the optimum is flat, the level is checked exactly
    def forms(chi: float, p: Matrix, y: Matrix) -> Sequence[Matrix]:
        return discrete_block(phi, gamma, pi, c=c, d=d, p=p, y=y, chi=chi), 1e-9 * np.eye(n) - p

    found = minimise(forms, {"chi": NONNEG, "p": n, "y": (m, n)}, clock, strict=0.0)
    return None if found is None else DiscretePoint(**found)


def certify_level(loop: SwitchedLoop, epsilon: float, clock: Clock) -> LevelPoint | None:
    """Return the least level that one P certifies for all delays of ``loop``, or None.

    Args:
        loop: loop at a few delays; each is a block.
        epsilon: relative threshold of the event trigger, or zero.
        clock: accumulates the time in solvers.
    """

    def forms(level_squared: float, p: Matrix, weight: float = 0.0) -> Sequence[Matrix]:
        at = partial(dissipation, loop, p=p, level_squared=level_squared, weight=weight)
        return *(at(i, epsilon=epsilon) for i in range(len(loop.a))), -p

    unknowns: dict[str, Unknown] = {"level_squared": NONNEG, "p": len(loop.a[0])}
    if epsilon:
        unknowns["weight"] = NONNEG
    found = minimise(forms, unknowns, clock, strict=LEVEL_STRICT)
    return None if found is None else LevelPoint(**{"weight": 0.0, **found})
