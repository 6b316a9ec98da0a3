"""Frequency weightings of ISO 2631-1 for the accelerations of a run, as second-order sections.

Each is the product of high pass and low pass at 0.4 and 100 Hz (Butterworth), the
acceleration-velocity transition and, for W_k, the upward step, with the standard's parameters
(ISO 2631-1:1997, table A.1).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from math import pi, sqrt

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.kernels.jit import njit
from canroll.typing import Vector

SAMPLE = STEP_NS * 1e-9
"""Time between two values of a signal (s)."""
HIGH_PASS, LOW_PASS = 0.4, 100.0
Ratio = tuple[tuple[float, ...], tuple[float, ...]]
"""Numerator and denominator, highest power of s first."""


@dataclass(frozen=True)
class Weighting:
    """A weighting: ``transition`` f_3 and f_4 (Hz) with ``quality`` Q_4.

    ``step``: f_5, Q_5, f_6, Q_6 of the upward step; None: it has none.
    """

    transition: tuple[float, float]
    quality: float
    step: tuple[float, float, float, float] | None = None

    @property
    def factors(self) -> tuple[Ratio, ...]:
        """The transfer functions that it is the product of."""
        low, high = 2 * pi * HIGH_PASS, 2 * pi * LOW_PASS
        third, fourth = (2 * pi * f for f in self.transition)
        factors: tuple[Ratio, ...] = (
            ((1.0, 0.0, 0.0), (1.0, sqrt(2) * low, low**2)),
            ((high**2,), (1.0, sqrt(2) * high, high**2)),
            (
                (fourth**2 / third, fourth**2),
                (1.0, fourth / self.quality, fourth**2),
            ),
        )
        if self.step is None:
            return factors
        f5, q5, f6, q6 = self.step
        fifth, sixth = 2 * pi * f5, 2 * pi * f6
        return (
            *factors,
            ((1.0, fifth / q5, fifth**2), (1.0, sixth / q6, sixth**2)),
        )

    @cached_property
    def sections(self) -> NDArray[np.float64]:
        """Second-order sections of :data:`SAMPLE`, by the bilinear transformation."""
        return np.array([_digital(*factor) for factor in self.factors])


def _digital(numerator: tuple[float, ...], denominator: tuple[float, ...]) -> Vector:
    """Return the section b0, b1, b2, 1, a1, a2 with s = 2 (z − 1)/(z + 1) / :data:`SAMPLE`."""
    root = sqrt(2 / SAMPLE)
    above, below = Polynomial((-1, 1)) * root, Polynomial((1, 1)) / root
    top, bottom = (
        sum(
            (c * below ** (2 - power) * above**power for power, c in enumerate(reversed(analog))),
            Polynomial([0.0]),
        ).coef[::-1]
        for analog in (numerator, denominator)
    )
    section: Vector = np.concatenate((top, bottom)) / bottom[0]
    return section


W_K = Weighting((12.5, 12.5), 0.63, (2.37, 0.91, 3.35, 0.91))
"""Vertical."""
W_D = Weighting((2.0, 2.0), 0.63)
"""Horizontal."""
W_E = Weighting((1.0, 1.0), 0.63)
"""Rotational."""


def weighted_rms(weighting: Weighting, parts: Iterable[Vector]) -> float:
    """Return the RMS of a weighted signal, whose ``parts`` follow each other; 0 without values."""
    sections = weighting.sections
    state = np.zeros((len(sections), 2))
    squares, count = 0.0, 0
    for values in parts:
        squares += float(np.sum(np.square(_filtered(sections, values, state))))
        count += len(values)
    return sqrt(squares / count) if count else 0.0


# scipy.signal has it too, and takes longer to import than a run to drive
@njit
def _filtered(sections: NDArray[np.float64], values: Vector, state: NDArray[np.float64]) -> Vector:
    """Return what the sections make of values, one after the other; their state is changed."""
    weighted = np.empty(len(values))
    for n in range(len(values)):
        value = values[n]
        for k in range(len(sections)):
            b0, b1, b2, _, a1, a2 = sections[k]
            given = value
            value = b0 * given + state[k, 0]
            state[k, 0] = b1 * given - a1 * value + state[k, 1]
            state[k, 1] = b2 * given - a2 * value
        weighted[n] = value
    return weighted
