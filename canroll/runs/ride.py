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
from numpy.typing import NDArray
from scipy.signal import bilinear, sosfilt

from canroll.typing import Vector
from plant_sim.kernels.instants import STEP_NS

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
        rows = [np.concatenate(bilinear(*factor, 1 / SAMPLE)) for factor in self.factors]
        return np.array(rows)


W_K = Weighting((12.5, 12.5), 0.63, (2.37, 0.91, 3.35, 0.91))
"""Vertical."""
W_D = Weighting((2.0, 2.0), 0.63)
"""Horizontal."""
W_E = Weighting((1.0, 1.0), 0.63)
"""Rotational."""


def weighted_rms(weighting: Weighting, parts: Iterable[Vector]) -> float:
    """Return the RMS of a weighted signal, whose ``parts`` follow each other; 0 without values."""
    state = np.zeros((len(weighting.sections), 2))
    squares, count = 0.0, 0
    for values in parts:
        weighted, state = sosfilt(weighting.sections, values, zi=state)
        squares += float(np.sum(np.square(weighted)))
        count += len(values)
    return sqrt(squares / count) if count else 0.0
