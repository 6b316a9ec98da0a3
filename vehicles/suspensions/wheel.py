"""The tables of an axle at the wheel, from where it stands at rest: for plants and designs.

With z the compression of the wheel, r = ds/dz the ratio of the spring's way to it, and F the
spring's force over its compression s, the force on the wheel is F(s(z)) r(z): of z alone, so that
no energy comes from a spring whatever the tables. Of a damper it is F(r z') r.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from math import sqrt

from canroll.errors import CanrollError
from canroll.vehicles.suspensions.curve import Curve, rises
from canroll.vehicles.suspensions.tables import AxleTables

CLOSE = 1e-5
"""Share of the largest force by which lines between points may miss a spring with a ratio."""
HALVINGS = 6
"""Of the distance between two points for that."""
FLAT = 1.0
"""Way (m) over which a ratio stays beyond the ends of its table."""
ONE = Curve((-FLAT, FLAT), (1.0, 1.0))


@dataclass(frozen=True, slots=True)
class WheelCurves:
    """Curves of one wheel over its compression from rest (m), outwards and upwards; None: no table.

    Attributes:
        rest: compression at rest, in the table's terms.
        spring: force (N) on the wheel, without stops.
        stops: force (N) of the stops.
        damper: force (N) at the damper over its speed of compression (m/s).
        damper_ratio: speed of the damper over that of the wheel.
        side: way (m) of the contact patch outwards.
        toe: inwards (rad); ``toe_by_force`` over the side force towards the middle of the car (N),
            ``toe_by_moment`` over the moment towards toe-in (N·m) add to it.
        camber: with the top outwards (rad), and its parts alike.
    """

    rest: float
    spring: Curve | None
    stops: Curve | None
    damper: Curve | None
    damper_ratio: Curve
    side: Curve | None
    toe: Curve | None
    toe_by_force: Curve | None
    toe_by_moment: Curve | None
    camber: Curve | None
    camber_by_force: Curve | None
    camber_by_moment: Curve | None

    @property
    def rate(self) -> float:
        """Rate (N/m) of the spring at rest, at the wheel."""
        return self.spring.slope(0.0) if self.spring is not None else 0.0

    @property
    def damping(self) -> tuple[float, float]:
        """Slopes of the damper at rest in compression and in rebound (N·s/m), at the wheel."""
        if self.damper is None:
            return 0.0, 0.0
        rebound, compression = self.damper.sides(0.0)
        square = self.damper_ratio(0.0) ** 2
        return compression * square, rebound * square

    @property
    def clearances(self) -> tuple[float, float]:
        """Ways (m) from rest to the stops in compression and in rebound."""
        if self.stops is None:
            return 0.0, 0.0
        free = [x for x, force in zip(self.stops.x, self.stops.y, strict=True) if force == 0.0]
        return free[-1], -free[0]

    @property
    def stop_rate(self) -> float:
        """Quadratic rate (N/m²) with the force of the bump stop at the end of its table."""
        if self.stops is None:
            return 0.0
        way = self.stops.x[-1] - self.clearances[0]
        return self.stops.y[-1] / way**2 if way > 0.0 else 1.0

    def change(self, name: str) -> float:
        """Slope at rest of a curve; 0 without it."""
        curve: Curve | None = getattr(self, name)
        return 0.0 if curve is None else curve.slope(0.0)


def installed(tables: AxleTables, carried: float, place: str) -> AxleTables:
    """Return the tables with the compression at which the spring carries ``carried`` (N).

    That of the wheel is 0 there. Tables without a spring, or that say it, stay as they are.

    Raises:
        CanrollError: the spring's table does not carry that; the message begins with ``place``.
    """
    spring = tables.spring
    if spring is None or tables.installed is not None:
        return tables
    needed = carried / _ratio(tables.spring_ratio)(0.0)
    if not spring.y[0] <= needed <= spring.y[-1]:
        raise CanrollError(
            f"{place}.spring carries {spring.y[0]:.0f} to {spring.y[-1]:.0f} N, but at rest "
            f"{needed:.0f} N stand on it: give the whole curve"
        )
    return replace(tables, installed=spring.where(needed))


@lru_cache(maxsize=256)
def at_rest(tables: AxleTables, carried: float, place: str = "") -> WheelCurves:
    """Return the curves of a wheel whose suspension carries ``carried`` (N) at rest.

    Raises:
        CanrollError: the tables hold no wheel there; the message begins with ``place``.
    """
    tables = installed(tables, carried, place)
    rest, spring = 0.0, None
    if tables.spring is not None:
        force = _at_wheel(tables)
        if not rises(force.y):
            raise CanrollError(
                f"{place}.spring with spring_ratio: the force at the wheel falls with compression"
            )
        if not force.y[0] <= carried <= force.y[-1]:
            raise CanrollError(
                f"{place}.spring carries {force.y[0]:.0f} to {force.y[-1]:.0f} N at the wheel, "
                f"but {carried:.0f} N stand on it"
            )
        rest = force.where(carried)
        spring = force.shifted(rest)

    def over_travel(curve: Curve | None) -> Curve | None:
        return None if curve is None else curve.shifted(rest)

    if tables.stops is not None and (force_there := tables.stops(rest)):
        raise CanrollError(
            f"{place}.stops: the wheel at rest, at a compression of {1e3 * rest:.0f} mm, stands on "
            f"a stop with {force_there:.0f} N"
        )
    return WheelCurves(
        rest=rest,
        spring=spring,
        stops=over_travel(tables.stops),
        damper=tables.damper,
        damper_ratio=_ratio(tables.damper_ratio).shifted(rest),
        side=over_travel(tables.side),
        toe=over_travel(tables.toe),
        toe_by_force=tables.toe_by_force,
        toe_by_moment=tables.toe_by_moment,
        camber=over_travel(tables.camber),
        camber_by_force=tables.camber_by_force,
        camber_by_moment=tables.camber_by_moment,
    )


def _ratio(curve: Curve | None) -> Curve:
    """A ratio that stays as it is beyond the ends of its table."""
    if curve is None:
        return ONE
    x, y = (curve.x[0] - FLAT, *curve.x, curve.x[-1] + FLAT), (curve.y[0], *curve.y, curve.y[-1])
    return Curve(x, y)


def _at_wheel(tables: AxleTables) -> Curve:
    """Force of the spring on the wheel over the wheel's compression."""
    spring, start = tables.spring, tables.installed
    assert spring is not None and start is not None
    if tables.spring_ratio is None:
        return spring.shifted(start)
    ratio = _ratio(tables.spring_ratio)
    ways = [0.0]
    for a, b in pairwise(ratio.x):
        ways.append(ways[-1] + 0.5 * (ratio(a) + ratio(b)) * (b - a))
    zero = _way(ratio, ways, 0.0)

    def force(z: float) -> float:
        return spring(start + _way(ratio, ways, z) - zero) * ratio(z)

    ends = [_back(ratio, ways, s - start + zero) for s in spring.x]
    points = sorted({*ends, *(x for x in (0.0, *ratio.x) if ends[0] < x < ends[-1])})
    near = CLOSE * max(map(abs, spring.y))
    x = [points[0]]
    for a, b in pairwise(points):
        x += [*_between(force, a, b, near, HALVINGS), b]
    return Curve(tuple(x), tuple(map(force, x)))


def _way(ratio: Curve, ways: list[float], z: float) -> float:
    """The spring's way up to the wheel's compression ``z``: a ratio's integral."""
    low = min(max(sum(x <= z for x in ratio.x) - 1, 0), len(ratio.x) - 2)
    a = ratio.x[low]
    return ways[low] + 0.5 * (ratio(a) + ratio(z)) * (z - a)


def _back(ratio: Curve, ways: list[float], way: float) -> float:
    """The wheel's compression at a way of the spring."""
    low = min(max(sum(each <= way for each in ways) - 1, 0), len(ways) - 2)
    start, more = ratio.y[low], way - ways[low]
    root = sqrt(max(start * start + 2.0 * ratio.slopes[low] * more, 0.0))
    return ratio.x[low] + 2.0 * more / (start + root)


def _between(
    force: Callable[[float], float], a: float, b: float, near: float, halvings: int
) -> list[float]:
    """Points between ``a`` and ``b`` that keep a line's middle ``near`` the force."""
    middle = 0.5 * (a + b)
    if halvings == 0 or abs(force(middle) - 0.5 * (force(a) + force(b))) <= near:
        return []
    return [
        *_between(force, a, middle, near, halvings - 1),
        middle,
        *_between(force, middle, b, near, halvings - 1),
    ]
