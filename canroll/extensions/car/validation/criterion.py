"""A figure of a manoeuvre, simulated against measured, and curves with tolerance bands."""

from dataclasses import dataclass
from math import radians
from typing import Any

from canroll.typing import Vector

GAINS = {
    "yaw_rate": ("yaw rate", "1/s", 1.0),
    "lateral_acceleration": ("lateral acceleration", "m/s² per °", radians(1.0)),
    "roll": ("roll", "° per °", 1.0),
}
"""Label, unit of a gain over the steering-wheel angle, and its factor, of each signal."""


@dataclass(frozen=True, slots=True)
class Criterion:
    """A figure of a manoeuvre: measured and simulated in ``unit``, and how far they may differ.

    ``tolerance`` is in the same unit; infinite: the figure is shown, not judged.
    """

    label: str
    measured: float
    simulated: float
    unit: str
    tolerance: float

    @property
    def passed(self) -> bool:
        """Whether the difference is within the tolerance."""
        return bool(abs(self.simulated - self.measured) <= self.tolerance)


@dataclass(frozen=True, slots=True, eq=False)
class ToleranceBand:
    """Measured points in a cross plot, and the simulated curve with its tolerance band.

    Attributes:
        name: of the quantity over ``over``.
        title: of the plot.
        xlabel: quantity and unit of the horizontal axis.
        unit: of the vertical one.
        measured: points, x and y.
        simulated: points, x and y.
        lower: boundary, x and y.
        upper: boundary, x and y.
        worst: largest distance of a measured point from the curve, in tolerances; above 1 it is
            outside of the band.
        at: its x.
    """

    name: str
    title: str
    xlabel: str
    unit: str
    measured: tuple[Vector, Vector]
    simulated: tuple[Vector, Vector]
    lower: tuple[Vector, Vector]
    upper: tuple[Vector, Vector]
    worst: float
    at: float

    @property
    def passed(self) -> bool:
        """Whether all measured points are within the band."""
        return self.worst <= 1.0

    def to_json(self) -> dict[str, Any]:
        """Return the points as plain data."""
        return {
            "name": self.name,
            "unit": self.unit,
            "worst": self.worst,
            "at": self.at,
            "passed": self.passed,
            "measured": [part.tolist() for part in self.measured],
            "simulated": [part.tolist() for part in self.simulated],
            "lower": [part.tolist() for part in self.lower],
            "upper": [part.tolist() for part in self.upper],
        }


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """What a manoeuvre says: its figures and its bands."""

    criteria: tuple[Criterion, ...] = ()
    bands: tuple[ToleranceBand, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether all are within their tolerances."""
        return all(one.passed for one in self.criteria) and all(b.passed for b in self.bands)
