"""A measured relation between two quantities: straight lines between its points."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

SAME = 1e-9
"""Share of the range of x within which a number is that of a point."""


@dataclass(frozen=True, slots=True)
class Curve:
    """Points (x, y) with increasing x, at least two; beyond the ends the last line goes on."""

    x: tuple[float, ...]
    y: tuple[float, ...]

    @property
    def slopes(self) -> tuple[float, ...]:
        """Slope of each of its lines."""
        points = zip(self.x, self.y, strict=True)
        return tuple((d - b) / (c - a) for (a, b), (c, d) in pairwise(points))

    def __call__(self, x: float) -> float:
        """Return y at ``x``."""
        low = min(max(bisect_right(self.x, x) - 1, 0), len(self.x) - 2)
        rise = (self.y[low + 1] - self.y[low]) / (self.x[low + 1] - self.x[low])
        return self.y[low] + (x - self.x[low]) * rise

    def sides(self, x: float) -> tuple[float, float]:
        """Return the slopes below and above ``x``, which differ at a point of the table."""
        last, near = len(self.x) - 2, SAME * (self.x[-1] - self.x[0])
        below = min(max(bisect_right(self.x, x - near) - 1, 0), last)
        above = min(max(bisect_right(self.x, x + near) - 1, 0), last)
        return self.slopes[below], self.slopes[above]

    def slope(self, x: float) -> float:
        """Return the mean of the slopes below and above ``x``."""
        below, above = self.sides(x)
        return 0.5 * (below + above)

    def where(self, y: float) -> float:
        """Return x at ``y`` of a curve whose y increases; beyond the ends the last line goes on."""
        return Curve(self.y, self.x)(y)

    def shifted(self, by: float) -> "Curve":
        """Return the curve with its zero of x at ``by``."""
        return Curve(tuple(x - by for x in self.x), self.y)

    def __add__(self, other: "Curve") -> "Curve":
        """Return the sum, with the points of both."""
        x = tuple(sorted({*self.x, *other.x}))
        return Curve(x, tuple(self(at) + other(at) for at in x))


def rises(values: Sequence[float]) -> bool:
    """Whether each value exceeds the one before."""
    return all(b > a for a, b in pairwise(values))
