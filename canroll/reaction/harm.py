"""From where on a run is harmful: the one definition, of faults, attacks and campaigns.

A fault, an attack or control itself is harmful where the largest roll angle or path error exceeds
1.1 times that of the vehicle without control. The roll angle φ = m h a_y / (k − m g h) grows by
more than the share of load that is added: this is less than what 10 % more load does, half of the
±20 % by which populations vary the sprung mass (:mod:`canroll.studies.variation`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

HARMFUL = 1.1
"""Factor on the largest value without control, above which it is harm."""


@dataclass(frozen=True, slots=True)
class HarmLimit:
    """A signal whose largest value can be harm.

    Attributes:
        signal: of the record of a run, SI units.
        label: its name in words.
        unit: as printed after the number.
        scale: from the SI unit to that unit.
        least: smallest value without control that is a measure, in that unit.
    """

    signal: str
    label: str
    unit: str
    scale: float
    least: float

    def limit(self, before: ArrayLike) -> NDArray[np.float64]:
        """Return the limit from the largest value without control, both in :attr:`unit`."""
        return np.asarray(HARMFUL * np.maximum(before, self.least), np.float64)

    def level(self, before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the largest value over its limit; 0 where there is none without control."""
        return np.where(before > 0, after / self.limit(before), 0.0)


ROLL_ANGLE = HarmLimit("roll", "roll angle", "°", 180 / np.pi, least=1.0)
"""Below 1° a road rolls the body."""
PATH_ERROR = HarmLimit("path_error", "path error", " m", 1.0, least=0.05)
LIMITS = (ROLL_ANGLE, PATH_ERROR)
