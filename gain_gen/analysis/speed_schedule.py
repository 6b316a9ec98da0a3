"""Factor on the command over speed: chosen by margins, checked at its points and between.

The slower the car, the more a moment moves the accelerometer; the faster, the less the tyres damp.
At each speed of the ECU's table the command is reduced as far as the margins require, laden and
empty, at every delay; the ECU interpolates.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf, log

import numpy as np
from scipy.linalg import eigh

from canroll.build_cache import kept
from canroll.gain_gen.analysis.family import NOMINAL, Condition, Family, family
from canroll.gain_gen.analysis.margins import factor_within
from canroll.gain_gen.models.controller import SPEEDS, LinearController, scaled_controller
from canroll.gain_gen.models.roll import Matrix, stationary_covariance
from canroll.gain_gen.models.state_space import Complex
from canroll.gain_gen.models.task import Design, Task, made_of

GAIN_MARGIN_DB = 8.2
PEAK_SENSITIVITY = 1.68
"""Margins for the choice of a factor, slightly more than required of every design."""
ABOUT_NOMINAL = 5.0
"""Distance within which speeds count as the nominal one, m/s."""
MOST = 10.0
"""Largest factor considered."""
UNLIMITED = (inf,) * len(SPEEDS)
"""Limits of a command without schedule."""
LOADS = ("laden", "empty")
STEP = 0.5
"""Step of the speeds of the Lyapunov functions, m/s; they are checked at half of it too."""
DECAY = 0.3
"""Decay of a Lyapunov function, as a fraction of the way from the spectral radius to 1."""
LINE_WEIGHT = 0.1
"""Weight of the commands under way in the Lyapunov functions; every other state has 1."""


@dataclass(frozen=True, slots=True)
class Speeds:
    """The families at each speed of the ECU's table and midway between."""

    families: tuple[Family, ...]

    def limits(self, controller: LinearController) -> tuple[float, ...]:
        """Return the largest factor at each speed of the table with which the loop has margins.

        Near the nominal speed there is no limit: a law without margins there is detuned as a
        whole.
        """
        return tuple(
            inf
            if abs(speed - NOMINAL.speed) < ABOUT_NOMINAL
            else min(largest_factor(gain) for gain in loop_gains(family, controller))
            for speed, family in zip(SPEEDS, self.families[::2], strict=True)
        )

    def worst(self, controller: LinearController) -> tuple[float, float]:
        """Return the least gain margin, dB, and the greatest Ms at all of the speeds."""
        rows = [row.margins for family in self.families for row in family.rows(controller)]
        return min(row.gain_db for row in rows), max(row.sensitivity for row in rows)


def speeds_of(task: Task) -> Speeds:
    """Return the families of a task at the speeds of the table and midway between.

    Raises:
        CanrollError: the data sheet does not define such a car.
    """
    between = [0.5 * (low + high) for low, high in pairwise(SPEEDS)]
    return Speeds(
        tuple(
            family(
                task.vehicle,
                task.delay,
                tick=task.tick,
                lag=task.lag,
                conditions=[Condition(load, speed) for load in LOADS],
            )
            for speed in sorted((*SPEEDS, *between))
        )
    )


def loop_gains(family: Family, controller: LinearController) -> Iterator[Complex]:
    """Yield the loop gain of every member at every delay, negative feedback."""
    response = family.controller_response(controller)
    for member in family.members:
        for delay in family.delays:
            yield np.asarray(-np.sum(response * member.commanded(delay), axis=1))


def largest_factor(gain: Complex) -> float:
    """Return the largest factor up to :data:`MOST` on a loop gain that keeps the margins."""
    return factor_within(
        gain, gain_db=GAIN_MARGIN_DB, sensitivity=PEAK_SENSITIVITY, most=MOST, halvings=12
    )


def scheduled(
    controller: LinearController, limits: tuple[float, ...], scale: float
) -> LinearController:
    """Return ``controller`` with its command scaled and limited at each speed.

    Args:
        controller: controller whose schedule is replaced.
        limits: upper limit of the factor on the unscaled command, at each of :data:`SPEEDS`.
        scale: factor on the command.
    """
    factors = tuple(min(1.0, limit / scale) for limit in limits)
    return replace(scaled_controller(controller, scale), schedule=factors)


def with_speed_rate(answer: Design) -> Design:
    """Return a design with ``checked_speed_rate`` among its numbers, if scheduled and verified.

    It takes as long as a fifth to a third of the design, and no check and no run depends on it.
    """
    if not answer.is_verified or "least_schedule_factor" not in answer.margins:
        return answer
    of = (answer.task, answer.controller)
    rate = kept("speed_rates", made_of(*of), lambda: checked_speed_rate(*of))
    return replace(answer, margins={**answer.margins, "checked_speed_rate": rate})


def checked_speed_rate(task: Task, controller: LinearController) -> float:
    """Return the largest rate of speed change, m/s², at which Lyapunov functions keep decaying.

    Piecewise Lyapunov functions x'P_i x at speeds v_i: P_i decays in every tick from v_(i−1) to
    v_(i+1), and the change from one to the next raises the function by at most μ. The longer the
    speed takes from v_i to its neighbour, the more the decay outweighs μ. At the longest delay,
    laden and empty, from the first to the last speed of the ECU's table. The decay of P_i is
    checked on a grid of half a :data:`STEP`, at five speeds each; between these it is not bounded.
    """
    return min(_speed_rate(task, controller, load) for load in LOADS)


def _speed_rate(task: Task, controller: LinearController, load: str) -> float:
    """Return the rate for one load; zero where a function does not decay."""
    halves = np.arange(SPEEDS[0], SPEEDS[-1] + 0.25 * STEP, 0.5 * STEP)
    longest = task.delay.most
    cars = family(
        task.vehicle,
        replace(task.delay, least=longest, nominal=longest),
        tick=task.tick,
        lag=task.lag,
        conditions=[Condition(load, float(speed)) for speed in halves],
    )
    loops = [member.loop(controller, cars.delays[-1]) for member in cars.members]
    plant, line = len(cars.members[0].plant.a), max(cars.members[0].held[cars.delays[-1]].steps, 1)
    weights = np.ones(len(loops[0].a))
    weights[plant : plant + line] = LINE_WEIGHT
    if max(np.abs(np.linalg.eigvals(loop.closed)).max() for loop in loops) >= 1.0:
        return 0.0
    middle = loops[len(loops) // 2]
    driven = middle.noise @ middle.noise.T + 1e-12 * np.eye(len(weights))
    size = np.sqrt(np.diag(stationary_covariance(middle.closed, driven)))
    closed = [loop.closed * size[None, :] / size[:, None] for loop in loops]
    functions = [lyapunov_function(a, weights) for a in closed[::2]]
    rate = inf
    for i, function in enumerate(functions):
        nearby = closed[max(0, 2 * i - 2) : 2 * i + 3]
        decay = max(growth(a.T @ function @ a, function) for a in nearby)
        if decay >= 1.0:
            return 0.0
        for other in functions[max(0, i - 1) : i + 2]:
            jump = growth(other, function)
            if other is not function and jump > 1.0:
                rate = min(rate, STEP * -log(decay) / (task.tick * log(jump)))
    return rate


def lyapunov_function(a: Matrix, weights: Matrix) -> Matrix:
    """Return P of x'P x that decays along a stable x⁺ = A x, scaled to trace 1."""
    radius = float(np.abs(np.linalg.eigvals(a)).max())
    decay = radius + DECAY * (1.0 - radius)
    function = stationary_covariance((a / decay).T, np.diag(weights))
    return np.asarray(function / np.trace(function), dtype=float)


def growth(after: Matrix, before: Matrix) -> float:
    """Return the largest ratio of two quadratic forms, the largest generalised eigenvalue."""
    return float(eigh(after, before, eigvals_only=True)[-1])
