"""Lag, delay and gain of an actuator from its commanded and its delivered moments.

Delivered is gain · lag(command(t − delay)) + offset, the lag of first order and the command held
from sample to sample, as on a bus: its response has a closed form, taken at the times at which the
delivered moment was sampled. Maximum a posteriori, as the car's numbers are; the priors are wide.
"""

from dataclasses import dataclass, replace
from itertools import product
from math import exp, inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from canroll.extensions.car.identification.colour import correlation_times, score_covariance
from canroll.extensions.car.identification.information import (
    Information,
    at_least,
    numbers_at,
    together,
)
from canroll.extensions.car.identification.unknowns import FittedNumber, Unknown
from canroll.plant_sim.kernels.jit import njit
from canroll.typing import Vector

STARTS = tuple(product((0.003, 0.012, 0.05, 0.2), np.linspace(0.0, 0.2, 41).tolist()))
"""Lags and delays (s) among which the search begins at the best."""
FASTEST, SLOWEST = 1e-4, 2.0
"""Bounds of a lag (s)."""
PASSES = 3
"""Searches, the last with the colour of what the one before leaves."""
INSIDE = 1e-6
"""Deviations by which a search begins within its bounds."""
PAIR = 2
"""Lag and delay, the first two numbers."""
DIFFERENCE = 1e-4
"""Step of the numerical derivatives, in standard deviations of the priors."""
EXACT = 1e-9
"""Residual of a signal in its own standard deviation that is rounding."""
REGION = 5.99
"""Rise of the sum of squares at the border of the region of 95 % of two numbers (χ²)."""
AWAY, WIDER = 3.0, 1.5
"""Deviations of the lag at which the sum of squares must have risen so much, else how much farther.
"""
TRIED, FINER = 41, 3
"""Delays that are tried with another lag, and how often, each time around the best."""


@njit
def response(
    times: Vector,
    command: Vector,
    at: Vector,
    lag: float,
    delay: float,
) -> Vector:
    """Return the moments (n) at increasing times ``at`` (s) that a lag makes of a held command.

    It has settled at the first command. ``times`` and ``command`` have shape (k,), in s and N·m.
    """
    result = np.empty(len(at))
    k, state = 0, command[0]
    for i in range(len(at)):
        t = at[i] - delay
        while k + 1 < len(times) and times[k + 1] <= t:
            state = command[k] + (state - command[k]) * np.exp((times[k] - times[k + 1]) / lag)
            k += 1
        since = max(t - times[k], 0.0)
        result[i] = command[k] + (state - command[k]) * np.exp(-since / lag)
    return result


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """An axle's actuator in a log: commands, held, and samples of the delivered moment."""

    times: Vector
    command: Vector
    at: Vector
    delivered: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Actuator:
    """A fitted actuator.

    Attributes:
        axle: of it.
        numbers: lag (s), delay (s), gain, and the offset (N·m) of what is measured.
        covariance: of them, in products of their units (4, 4).
        pairs: labels of numbers identifiable only together, and their correlation.
        explained: share of the delivered moment's variance.
        seconds: of the log that were compared.
    """

    axle: str
    numbers: tuple[FittedNumber, ...]
    covariance: NDArray[np.float64]
    pairs: tuple[tuple[str, str, float], ...]
    explained: float
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data; ``covariance`` is in the order of ``numbers``."""
        return {
            "axle": self.axle,
            "numbers": [number.to_json() for number in self.numbers],
            "covariance": self.covariance.tolist(),
            "identifiable_together": [list(pair) for pair in self.pairs],
            "explained": self.explained,
            "seconds": self.seconds,
        }

    def delivered(self, times: Vector, command: Vector, at: Vector) -> Vector:
        """Return the moments (n) that it delivers at times (s) on commands held from ``times`` on.

        The offset is not in them: it is one of the measurement.
        """
        lag, delay, gain, _ = (number.value for number in self.numbers)
        return np.asarray(gain * response(times, command, at, lag, delay))


def first_guess(moved: Moved) -> tuple[float, float, float, float]:
    """Return the best lag and delay of :data:`STARTS`, its regression's slope and correlation."""
    best = 0.0, 0.0, 0.0, 0.0
    y = moved.delivered - moved.delivered.mean()
    for lag, delay in STARTS:
        x = response(moved.times, moved.command, moved.at, lag, delay)
        x = x - x.mean()
        xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
        if xx * yy > 0.0 and abs(xy) / np.sqrt(xx * yy) > abs(best[3]):
            best = lag, delay, xy / xx, xy / np.sqrt(xx * yy)
    return best


def unknowns_of(lag: Unknown, axle: str, size: float) -> tuple[Unknown, ...]:
    """Return the unknowns of an axle's actuator: lag as in the file, delay, gain and offset.

    ``size`` (N·m) is the standard deviation of its commands: offsets are as small.
    """
    key, name = f"actuator.{axle}", f"actuator {axle}"
    return (
        replace(lag, key=f"{key}.lag", label=f"{name}, lag", least=FASTEST, most=SLOWEST),
        Unknown(f"{key}.delay", f"{name}, delay", "s", 0.0, 0.05, -0.1, 0.5, "usual"),
        Unknown(f"{key}.gain", f"{name}, gain", "", 1.0, 0.3, 0.02, 50.0, "usual", positive=True),
        Unknown(f"{key}.offset", f"{name}, offset", "N·m", 0.0, size, -9 * size, 9 * size, "usual"),
    )


class _Problem:
    """The residuals of an actuator over the coordinates of its unknowns."""

    def __init__(self, moved: Moved, sought: tuple[Unknown, ...]) -> None:
        self.moved, self.sought = moved, sought

    @property
    def bounds(self) -> tuple[Vector, Vector]:
        """Bounds of the coordinates."""
        low = [unknown.coordinate(unknown.least) for unknown in self.sought]
        high = [unknown.coordinate(unknown.most) for unknown in self.sought]
        return np.array(low), np.array(high)

    def values(self, x: Vector) -> list[float]:
        return [u.value(at) for u, at in zip(self.sought, x.tolist(), strict=True)]

    def errors(self, x: Vector) -> Vector:
        """Return modelled minus measured moments, N·m."""
        lag, delay, gain, offset = self.values(x)
        moved = self.moved
        moment = gain * response(moved.times, moved.command, moved.at, lag, delay)
        return np.asarray(moment + offset - moved.delivered)

    def slopes(self, x: Vector) -> NDArray[np.float64]:
        """Return their derivatives, (n, 4)."""
        steps = DIFFERENCE * np.eye(x.size)
        rises = [self.errors(x + step) - self.errors(x - step) for step in steps]
        return np.column_stack(rises) / (2.0 * DIFFERENCE)

    def searched(self, x: Vector, scale: float) -> Vector:
        """Search from ``x`` with residuals over ``scale`` (N·m), and with the priors."""

        def weighted(at: Vector) -> Vector:
            return np.concatenate((self.errors(at) / scale, at))

        def slopes(at: Vector) -> NDArray[np.float64]:
            return np.concatenate((self.slopes(at) / scale, np.eye(at.size)))

        return np.asarray(least_squares(weighted, x, slopes, self.bounds, x_scale="jac").x)

    def nearest(self, lag: float, around: float, reach: float) -> tuple[float, float]:
        """Return the least sum of squares with a lag, and its delay within ``reach`` (s)."""
        moved = self.moved
        best = inf, around
        y = moved.delivered - moved.delivered.mean()
        for _ in range(FINER):
            middle = best[1]
            for delay in np.linspace(middle - reach, middle + reach, TRIED).tolist():
                x = response(moved.times, moved.command, moved.at, lag, delay)
                x = x - x.mean()
                xx, xy = float(x @ x), float(x @ y)
                best = min(best, (float(y @ y) - (xy * xy / xx if xx > 0.0 else 0.0), delay))
            reach *= 4.0 / TRIED
        return best


def _blurred(problem: _Problem, x: Vector, scale: float, deviation: float) -> tuple[float, float]:
    """Return how far lag and delay (s) may be from those at ``x``; 0 if ``deviation`` says it.

    Samples that are rarer than the lag is long tell only a pair of them: then other lags with
    their delays fit as well, far beyond the lag's deviation, which is that of a small step.
    """
    lag, delay, *_ = problem.values(x)
    unknown, period = problem.sought[0], float(np.median(np.diff(problem.moved.at)))
    least = float(np.sum(problem.errors(x) ** 2))
    far = 0.0, 0.0
    for sign in (-1.0, 1.0):
        steps, other = AWAY, delay
        while unknown.least < (there := lag * exp(sign * steps * deviation / lag)) < unknown.most:
            squares, other = problem.nearest(there, delay, abs(there - lag) + period)
            if (squares - least) / scale**2 > REGION:
                break
            far = max(far[0], abs(there - lag)), max(far[1], abs(other - delay))
            steps *= WIDER
    return far[0] / sqrt(REGION), far[1] / sqrt(REGION)


def fitted(moved: Moved, sought: tuple[Unknown, ...], axle: str) -> Actuator:
    """Fit an actuator.

    A lag and a delay that the log tells only as a pair are identified together only.

    Args:
        moved: commands that move, and what became of them.
        sought: of :func:`unknowns_of`.
        axle: whose it is.
    """
    problem = _Problem(moved, sought)
    lag, delay, gain, _ = first_guess(moved)
    low, high = problem.bounds
    begin = zip(sought, (lag, delay, gain, 0.0), strict=True)
    x = np.clip([u.coordinate(value) for u, value in begin], low + INSIDE, high - INSIDE)
    every = np.ones((moved.at.size, 1), bool)
    for search in range(PASSES):
        left = problem.errors(x)
        scale = max(float(np.sqrt(np.mean(left**2))), EXACT * float(np.std(moved.delivered)))
        if search == PASSES - 1:
            scale *= float(np.sqrt(correlation_times(left[:, None], every)[0]))
        x = problem.searched(x, scale)
    left, scaled = problem.errors(x), problem.slopes(x) / scale
    scores = score_covariance((scaled / scale)[:, None, :], left[:, None], every)
    fisher, free = scaled.T @ scaled, np.ones(x.size, bool)
    white = fisher * np.mean(left**2) / scale**2
    content = Information(fisher, at_least(scores, white))
    covariance = content.covariance(free)
    numbers = numbers_at(sought, x, covariance, free)
    # at so many deviations the squares over this scale rise by their square, were they a parabola
    scale *= float(np.sqrt(covariance[0, 0])) / float(content.least(free)[0])
    far = _blurred(problem, x, scale, numbers[0].deviation)
    pairs = together(covariance, [unknown.label for unknown in sought])
    sizes = np.array([number.unknown.slope(number.value) for number in numbers])
    covariance = covariance * np.outer(sizes, sizes)
    if any(far):
        own = np.array([number.deviation for number in numbers])
        wide = np.maximum(own, (*far, 0.0, 0.0))
        grown = wide / np.sqrt(np.diag(covariance))
        covariance = covariance * np.outer(grown, grown)
        numbers = tuple(
            replace(n, deviation=d, state="together" if k < PAIR else n.state)
            for k, (n, d) in enumerate(zip(numbers, wide.tolist(), strict=True))
        )
    return Actuator(
        axle,
        numbers,
        covariance,
        tuple(pairs),
        1.0 - float(np.var(left) / np.var(moved.delivered)),
        float(moved.at.size * np.median(np.diff(moved.at))),
    )
