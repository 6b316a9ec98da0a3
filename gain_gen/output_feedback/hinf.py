"""H∞ output feedback on the driven car: γ by bisection, every solution checked on the loop."""

from dataclasses import dataclass
from math import inf, pi, sqrt

import numpy as np
from scipy.signal import cont2discrete, zpk2ss

from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.state_space import StateSpace
from canroll.gain_gen.output_feedback.central import Generalised, Quadruple, central_controller
from canroll.gain_gen.output_feedback.driven_car import DrivenCar

ROLL_OFF = 2.0 * pi * 3.0
"""Commands faster than this cost more, rad/s: at 8 Hz the wheels hop whatever the moment."""
ROLL_OFF_SPAN = 6.0
"""Frequencies over which the cost rises, by its square."""
BACK = 1.1
"""Level of the controller over the least level, at which it would be ill-conditioned."""
LEVEL_SHARE = 0.02
"""Accuracy of the least level, as share of it."""
LARGEST_LEVEL = 1e4
GRID = 400


@dataclass(frozen=True, slots=True)
class Synthesis:
    """A controller and its level.

    Attributes:
        controller: of full order.
        bound: level that it was computed for.
        level: what the loop really has, on a frequency grid.
    """

    controller: StateSpace
    bound: float
    level: float


def hinf(car: DrivenCar, weight: float) -> Synthesis | None:
    """Return the H∞ controller, or None if the solver finds no stabilising one.

    Args:
        car: disturbed by steering, unknown angle, roll moment and noise of unit size.
        weight: degrees of roll that a kN·m counts for, below the roll-off.
    """
    plant = weighted(car, weight)
    continuous = to_continuous(plant, car.tick)
    low, high = 0.0, 1.0
    while _central(continuous, high) is None:
        high *= 2.0
        if high > LARGEST_LEVEL:
            return None
    while high - low > LEVEL_SHARE * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _central(continuous, middle) is None else (low, middle)
    bound = BACK * high
    central = _central(continuous, bound)
    if central is None:
        return None
    controller = StateSpace(*to_discrete(central, car.tick), car.tick)
    level = closed_level(plant, controller, car.tick)
    return Synthesis(controller, bound, level) if level < inf else None


def _central(plant: Generalised, level: float) -> Quadruple | None:
    try:
        return central_controller(plant, level)
    except np.linalg.LinAlgError:
        return None


def weighted(car: DrivenCar, weight: float) -> Generalised:
    """Return the discrete plant with the cost of the command and the noise of the readings."""
    fast = ROLL_OFF_SPAN * ROLL_OFF
    zeros, poles = [-ROLL_OFF] * 2, [-fast] * 2
    analogue = zpk2ss(zeros, poles, ROLL_OFF_SPAN**2)
    wa, wb, wc, wd, _ = cont2discrete(analogue, car.tick, "bilinear")
    n, order = len(car.a), len(wa)
    a = np.zeros((n + order, n + order))
    a[:n, :n], a[n:, n:] = car.a, wa
    disturbances, readings = car.driven.shape[1], len(car.measured)
    b = np.zeros((n + order, disturbances + readings + 1))
    b[:n, :disturbances], b[:n, -1:], b[n:, -1:] = car.driven, car.command, wb
    errors = len(car.rolled) + 1
    c, d = np.zeros((errors + readings, n + order)), np.zeros((errors + readings, b.shape[1]))
    c[: errors - 1, :n], c[errors - 1, n:], c[errors:, :n] = car.rolled, weight * wc, car.measured
    d[errors - 1, -1] = weight * wd[0, 0]
    d[errors:, disturbances:-1] = np.diag(car.noise)
    return Generalised(a, b, c, d, 1, readings)


def to_continuous(plant: Generalised, tick: float) -> Generalised:
    """Return the plant by the bilinear transform, balanced: it keeps every H∞ level."""
    even, _ = StateSpace(plant.a, plant.b, plant.c, plant.d, tick).balanced()
    a, b, c = even.a, even.b, even.c
    identity = np.eye(len(a))
    inverse = np.linalg.inv(a + identity)
    return Generalised(
        2.0 / tick * inverse @ (a - identity),
        2.0 / sqrt(tick) * inverse @ b,
        2.0 / sqrt(tick) * c @ inverse,
        plant.d - c @ inverse @ b,
        plant.commands,
        plant.readings,
    )


def to_discrete(controller: Quadruple, tick: float) -> Quadruple:
    """Return the controller by the inverse transform."""
    a, b, c, d = controller
    identity = 2.0 / tick * np.eye(len(a))
    inverse = np.linalg.inv(identity - a)
    return (
        inverse @ (identity + a),
        2.0 / sqrt(tick) * inverse @ b,
        2.0 / sqrt(tick) * c @ inverse,
        d + c @ inverse @ b,
    )


def closed_level(plant: Generalised, controller: StateSpace, tick: float) -> float:
    """Return the level of the closed loop on a frequency grid; infinite if it is unstable."""
    m1, p1 = plant.sizes
    b1, b2, c1, c2 = plant.b[:, :m1], plant.b[:, m1:], plant.c[:p1], plant.c[p1:]
    d12, d21 = plant.d[:p1, m1:], plant.d[p1:, :m1]
    k = controller
    a = np.block([[plant.a + b2 @ k.d @ c2, b2 @ k.c], [k.b @ c2, k.a]])
    b = np.vstack([b1 + b2 @ k.d @ d21, k.b @ d21])
    c = np.hstack([c1 + d12 @ k.d @ c2, d12 @ k.c])
    d: Matrix = plant.d[:p1, :m1] + d12 @ k.d @ d21
    grid = np.concatenate([[0.0], np.geomspace(1e-2, pi / tick, GRID)])
    return float(StateSpace(a, b, c, d, tick).gains(grid).max())
