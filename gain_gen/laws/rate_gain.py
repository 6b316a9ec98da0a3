"""The static roll-rate gain by min–max over the family of cars and the delays of the task.

No inequality is needed: the gain is one number, and the exact sampled response to a roll moment on
the body costs a tenth of a millisecond per point. Among the gains with which every loop has its
margins, the one with the best worst case is chosen.
"""

from dataclasses import dataclass
from math import log

import numpy as np
from scipy.optimize import minimize_scalar

from canroll.gain_gen.analysis.family import Family, Member
from canroll.gain_gen.analysis.margins import factor_within
from canroll.gain_gen.analysis.verify import GAIN_MARGIN_DB, PEAK_SENSITIVITY
from canroll.gain_gen.models.controller import Y_RATE, Y_ROLL
from canroll.gain_gen.models.state_space import Complex

INSIDE = 0.99
"""Share of the largest gain that has the margins: the checks interpolate between frequencies."""
RESONANT = 1.005
"""A peak of the roll over its steady value that counts as resonance."""
SMALLEST = 1e-3
"""Fraction of that gain at which the search starts."""


@dataclass(frozen=True, slots=True)
class RateGain:
    """The best gain and its effect.

    Attributes:
        gain: N·m·s/rad, negative.
        peak_ratio: peak response of roll angle to a roll moment relative to the same car's without
            control, worst over members and delays.
        where: member and delay of the worst case.
        largest: the largest gain that has the margins, N·m·s/rad, negative.
        resonant: whether roll without control has a resonance there.
        least: of ``peak_ratio``: the steady roll over the largest, worst over members. No roll-rate
            gain leaves less, for the steady roll has no rate.
    """

    gain: float
    peak_ratio: float
    where: str
    largest: float
    resonant: bool
    least: float


@dataclass(frozen=True, slots=True)
class _Channel:
    """Responses of one member at one delay, for u = −g · roll rate."""

    name: str
    loop: Complex
    roll: Complex
    free: Complex
    free_rate: Complex

    @property
    def steady(self) -> float:
        """The steady roll over the largest, without control."""
        roll = np.abs(self.free)
        return float(roll[0] / roll.max())

    def peak_ratio(self, gain: float) -> float:
        closed: Complex = self.free - gain * self.roll * self.free_rate / (1.0 + gain * self.loop)
        return float(np.abs(closed).max() / np.abs(self.free).max())


def _channel(member: Member, delay: float) -> _Channel:
    commanded, disturbed = member.commanded(delay), member.disturbed
    return _Channel(
        name=f"{member.condition}, delay {1e3 * delay:.4g} ms",
        loop=commanded[:, Y_RATE],
        roll=commanded[:, Y_ROLL],
        free=disturbed[:, Y_ROLL],
        free_rate=disturbed[:, Y_RATE],
    )


def best_rate_gain(family: Family) -> RateGain:
    """Return the roll-rate gain of least worst-case peak among those with the margins."""
    channels = [_channel(member, delay) for member in family.members for delay in family.delays]
    largest = INSIDE * min(
        factor_within(channel.loop, gain_db=GAIN_MARGIN_DB, sensitivity=PEAK_SENSITIVITY)
        for channel in channels
    )

    def worst(log_gain: float) -> float:
        return max(channel.peak_ratio(float(np.exp(log_gain))) for channel in channels)

    grid = np.linspace(log(SMALLEST * largest), log(largest), 24)
    values = [worst(float(point)) for point in grid]
    best = int(np.argmin(values))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    minimum = minimize_scalar(worst, bounds=bounds, method="bounded", options={"xatol": 1e-3})
    gain = float(np.exp(minimum.x if minimum.fun < values[best] else grid[best]))
    limiting = max(channels, key=lambda channel: channel.peak_ratio(gain))
    free = np.abs(limiting.free)
    resonant = bool(free.max() > RESONANT * free[0])
    return RateGain(
        gain=-gain,
        peak_ratio=limiting.peak_ratio(gain),
        where=limiting.name,
        largest=-largest,
        resonant=resonant,
        least=max(channel.steady for channel in channels),
    )


def free_peak(member: Member) -> float:
    """Return the largest roll angle over a roll moment without control, rad per N·m."""
    return float(np.abs(member.disturbed[:, Y_ROLL]).max())
