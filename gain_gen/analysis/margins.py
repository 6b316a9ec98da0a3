"""Margins of a sampled loop: gain, phase, modulus, largest delay, tolerance of jitter."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import floor, inf, log10, pi, sqrt

import numpy as np

from canroll.gain_gen.analysis.sampled_loop import SampledLoop, loop_gain, spectral_radius
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.state_space import Complex

REAL_ENOUGH = 0.05
"""A loop gain whose imaginary part is this share of the real one crosses the axis at ω → 0."""


@dataclass(frozen=True, slots=True)
class Margins:
    """Classical margins where the command leaves the ECU.

    Attributes:
        gain_db: least change of the loop gain, up or down, that destabilises, dB; for an unstable
            loop minus the change that would stabilise it, minus infinity if none does.
        phase_deg: least lag at a crossing of unit gain that destabilises, degrees.
        modulus: least distance of the Nyquist curve from −1; zero for an unstable loop.
        crossover: highest frequency of unit gain, rad/s; zero where the gain stays below one.
        radius: largest modulus of the closed loop's eigenvalues.
    """

    gain_db: float
    phase_deg: float
    modulus: float
    crossover: float
    radius: float

    @property
    def sensitivity(self) -> float:
        """Ms, the peak of |1 / (1 + L)|; infinite for an unstable loop."""
        return 1.0 / self.modulus if self.modulus > 0.0 else inf


def nyquist_grid(tick: float, points: int = 1500) -> Matrix:
    """Return a logarithmic grid of frequencies up to the Nyquist frequency, rad/s."""
    return np.geomspace(1e-2, pi / tick, points)


def margins(loop: SampledLoop) -> Margins:
    """Return the margins of a sampled loop, interpolated on a dense grid."""
    frequencies = nyquist_grid(loop.tick)
    return nyquist_margins(frequencies, loop_gain(loop, frequencies), loop)


def nyquist_margins(frequencies: Matrix, gain: Complex, loop: SampledLoop) -> Margins:
    """Return the margins from the loop gain L, negative feedback; ``loop`` decides on stability.

    Args:
        frequencies: rad/s, ascending to the Nyquist frequency.
        gain: L there.
        loop: the same loop.
    """
    real = negative_crossings(gain)
    radius = spectral_radius(loop)
    if radius >= 1.0:
        return Margins(_stabilising_db(loop, real), 0.0, 0.0, 0.0, radius)
    gain_db = min((abs(20.0 * log10(-value)) for value in real), default=inf)
    level = np.log(np.maximum(np.abs(gain), np.finfo(float).tiny))
    phase_deg, crossover = inf, 0.0
    for i in np.flatnonzero(np.sign(level[1:]) != np.sign(level[:-1])):
        share = level[i] / (level[i] - level[i + 1])
        at = gain[i] + share * (gain[i + 1] - gain[i])
        phase_deg = min(phase_deg, float(np.degrees(np.mod(np.angle(-at), 2.0 * pi))))
        crossover = float(frequencies[i] + share * (frequencies[i + 1] - frequencies[i]))
    return Margins(gain_db, phase_deg, float(np.abs(1.0 + gain).min()), crossover, radius)


def negative_crossings(gain: Complex) -> list[float]:
    """Return the crossings of the Nyquist curve with the negative real axis, including its ends."""
    imaginary = gain.imag
    crossings = []
    for i in np.flatnonzero(np.sign(imaginary[1:]) != np.sign(imaginary[:-1])):
        share = imaginary[i] / (imaginary[i] - imaginary[i + 1])
        crossings.append(float(gain.real[i] + share * (gain.real[i + 1] - gain.real[i])))
    crossings += [
        float(end.real)
        for end in (gain[0], gain[-1])
        if abs(end.imag) <= REAL_ENOUGH * abs(end.real)
    ]
    return [value for value in crossings if value < -np.finfo(float).tiny]


def factor_within(
    gain: Complex, *, gain_db: float, sensitivity: float, most: float = 1e12, halvings: int = 30
) -> float:
    """Return the largest factor on a loop gain that keeps a gain margin and a peak sensitivity.

    The loop is stable for small factors; the first crossing of −1 is the one that counts.

    Args:
        gain: L on a grid of frequencies, negative feedback.
        gain_db: least gain margin, dB.
        sensitivity: largest Ms.
        most: largest factor.
        halvings: of the interval in the search.
    """
    nearest = max((-value for value in negative_crossings(gain)), default=0.0)
    high = min(most, 10.0 ** (-gain_db / 20.0) / nearest) if nearest > 0.0 else most

    def keeps(factor: float) -> bool:
        return 1.0 / float(np.abs(1.0 + factor * gain).min()) <= sensitivity

    if keeps(high):
        return high
    low = 0.0
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return low


def _stabilising_db(loop: SampledLoop, crossings: list[float]) -> float:
    """Return the smallest change of an unstable loop's gain that stabilises it, dB."""
    for value in sorted(value for value in crossings if value < -1.0)[::-1]:
        factor = -1.0 / value
        if spectral_radius(replace(loop, c=0.999 * factor * loop.c)) < 1.0:
            return 20.0 * log10(factor)
    return -inf


def largest_delay_from(
    start: float, stable: Callable[[float], bool], tick: float, *, limit: float
) -> float:
    """Return the smallest delay above ``start`` at which a sampled loop loses stability, s.

    Args:
        start: lower end of the search, s; zero is returned if the loop is unstable there.
        stable: function of a constant delay in seconds, true if the loop is stable.
        tick: grid step of the search, s; the edge is then bisected to 0.1 ms.
        limit: return infinity if the loop is stable up to this delay, s.
    """
    if not stable(start):
        return 0.0
    below, above = start, start + max(tick, 0.05 * start)
    while stable(above):
        if above >= limit:
            return inf
        below, above = above, above + max(tick, 0.05 * above)
    while above - below > 1e-4:
        middle = 0.5 * (below + above)
        if stable(middle):
            below = middle
        else:
            above = middle
    return below


def jitter_level(
    frequencies: Matrix, gain: Complex, aliased: Matrix, *, tick: float, jitter: float
) -> float:
    """Return the small-gain level of a delay that varies by ± ``jitter``/2 about the loop's own.

    Below one the loop is stable for any sequence of delays within these bounds: theorem 3 of Kao
    and Lincoln (2004), whose delay varies upwards only, with the delay counted from its middle.

    Samples are periodic: the variation counts as that of the way to the actuator, which holds the
    newest command that has arrived. Instead of at its nominal instant, the step ∇u from one command
    to the next then acts up to N ticks earlier or later, N half the span in ticks. The difference w
    of the held signals is at any instant the sum of the steps that are out of place, all of them
    late or all early: at most ⌊N⌋ of them, or one more in a share g = N − ⌊N⌋ of each tick. By
    Cauchy and Schwarz, summed over the time that each step is out of place, ‖w‖² ≤ T Ñ² ‖∇u‖² with
    Ñ² = ⌊N⌋² + (2⌊N⌋ + 1) g. From w through the plant P and the sampler to the command C y leads
    Σ_k C P(jω_k) W(jω_k) / T, ω_k = ω + 2πk/T, which by Cauchy and Schwarz over k is at most √(Σ|C
    P(jω_k)|²) ‖w‖ / √T; the nominal loop divides it by 1 + L, and z − 1 makes steps of commands.
    The product of both gains is the level.

    Args:
        frequencies: rad/s, ascending to the Nyquist frequency; the level is the largest on them.
        gain: L there, of the loop at the middle delay, negative feedback; it must be stable.
        aliased: √(Σ|C P(jω_k)|²) there, from :func:`canroll.gain_gen.analysis.held_plant.aliased`.
        tick: T, s.
        jitter: longest less least delay, s.
    """
    if jitter <= 0.0:
        return 0.0
    ticks = 0.5 * jitter / tick
    rest = ticks - floor(ticks)
    reach = sqrt(floor(ticks) ** 2 + (2.0 * floor(ticks) + 1.0) * rest)
    z = np.exp(1j * frequencies * tick)
    return float(np.max(aliased * np.abs((z - 1.0) / (1.0 + gain))) * reach)
