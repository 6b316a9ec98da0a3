"""Springs, dampers and stops of the 14-DOF car by numbers or tables; toe, camber, steer by tables.

The car's record has the points of all curves of both axles, and where the curve of each purpose
is. Curves are those of a wheel over its compression from rest; see
:mod:`canroll.vehicles.suspensions.wheel`. A spring's and a damper's is scaled to the vehicle's
number, which is that of the curve unless it was changed, as in a population. The steering's is over
the plants' steer.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from canroll.errors import CanrollError
from canroll.plant_sim.kernels.jit import inlined, njit
from canroll.typing import Vector
from canroll.vehicles import Vehicle
from canroll.vehicles.axles import Axle, rebound_ratio, road_wheel_curve
from canroll.vehicles.suspensions import tables
from canroll.vehicles.suspensions.curve import Curve
from canroll.vehicles.suspensions.wheel import WheelCurves

PURPOSES = ("spring", "stops", "damper", "damper_ratio", *tables.TOE, *tables.CAMBER)
"""Curves of an axle by their names in :class:`canroll.vehicles.suspensions.wheel.WheelCurves`."""
SPRING, STOPS, DAMPER, DAMPER_RATIO, TOE = range(5)
CAMBER = TOE + len(tables.TOE)
STEERING = CAMBER + len(tables.CAMBER)
N_CURVES = STEERING + 1
COMPLIANT = 3.0
"""Times that an evaluation determines the attitude of the wheels and their forces in turn."""
POINTS = 1600
"""Most points of all curves of a car."""


@njit
def lookup(points: Vector, first: float, rows: float, x: float) -> float:
    """Value at ``x`` of a curve of ``rows`` points; beyond the ends the last line goes on."""
    low = int(first)
    high = low + int(rows) - 2
    while low < high:
        middle = (low + high + 1) // 2
        if points[2 * middle] <= x:
            low = middle
        else:
            high = middle - 1
    x0, y0 = points[2 * low], points[2 * low + 1]
    value: float = y0 + (x - x0) * ((points[2 * low + 3] - y0) / (points[2 * low + 2] - x0))
    return value


@inlined
def spring(axle: Any, points: Vector, travel: float) -> float:  # noqa: ANN401
    """Force (N) between body and wheel of a spring extended by ``travel`` (m) from rest."""
    force: float = axle.preload - axle.spring * travel
    if axle.rows[SPRING] > 0.0:
        force = lookup(points, axle.first[SPRING], axle.rows[SPRING], -travel)
    return force


@inlined
def damper(axle: Any, points: Vector, travel: float, rate: float) -> float:  # noqa: ANN401
    """Force (N) of a damper against the ``rate`` (m/s, extension > 0) of the travel (m)."""
    if axle.rows[DAMPER] > 0.0:
        ratio = lookup(points, axle.first[DAMPER_RATIO], axle.rows[DAMPER_RATIO], -travel)
        at_damper = lookup(points, axle.first[DAMPER], axle.rows[DAMPER], -rate * ratio)
        return -at_damper * ratio
    slope = axle.rebound if rate > 0.0 else axle.bump
    fast = max(abs(rate) - axle.knee_speed, 0.0)
    size: float = slope * (min(abs(rate), axle.knee_speed) + axle.high_speed_ratio * fast)
    return size if rate > 0.0 else -size


@inlined
def stop(axle: Any, points: Vector, travel: float) -> float:  # noqa: ANN401
    """Force (N) on the body, upwards, of stops: a table's, or quadratic beyond the clearances."""
    force = 0.0
    if axle.rows[STOPS] > 0.0:
        force = lookup(points, axle.first[STOPS], axle.rows[STOPS], -travel)
    else:
        if travel > axle.rebound_clearance:
            force = -axle.stop_rate * (travel - axle.rebound_clearance) ** 2
        if travel < -axle.bump_clearance:
            force = axle.stop_rate * (travel + axle.bump_clearance) ** 2
    return force


@inlined
def angle(  # noqa: PLR0917
    axle: Any,  # noqa: ANN401
    points: Vector,
    kind: int,
    travel: float,
    force: float,
    moment: float,
) -> float:
    """Toe or camber (rad) of a wheel by travel (m), side force (N) and aligning moment (N·m)."""
    total = 0.0
    if axle.rows[kind] > 0.0:
        total += lookup(points, axle.first[kind], axle.rows[kind], -travel)
    if axle.rows[kind + 1] > 0.0:
        total += lookup(points, axle.first[kind + 1], axle.rows[kind + 1], force)
    if axle.rows[kind + 2] > 0.0:
        total += lookup(points, axle.first[kind + 2], axle.rows[kind + 2], moment)
    return total


@inlined
def road_wheel(axle: Any, points: Vector, steer: float, side: float) -> float:  # noqa: ANN401
    """Angle (rad) of a wheel by the steering alone; ``side`` is 1 on the left, -1 on the right."""
    angle = steer
    if axle.rows[STEERING] > 0.0:
        angle = side * lookup(points, axle.first[STEERING], axle.rows[STEERING], side * steer)
    return angle


def fill(car: Any, axles: Sequence[Axle], vehicle: Vehicle) -> None:  # noqa: ANN401
    """Fill the record of a car with the curves of its axles.

    Raises:
        CanrollError: tables that hold no wheel of that load, or too many points.
    """
    used, ratio = 0, vehicle.suspension.rebound_bump_ratio / rebound_ratio(axles)
    for k, axle in enumerate(axles):
        record = car["axle"][k]
        steering = road_wheel_curve(vehicle) if k == 0 else None
        for number, curve in enumerate((*_curves(axle, ratio), steering)):
            if curve is None:
                continue
            rows = len(curve.x)
            if used + rows > POINTS:
                raise CanrollError(
                    f"{vehicle.name}: the tables of both axles need more than {POINTS} points: "
                    "give fewer rows"
                )
            record["first"][number], record["rows"][number] = used, rows
            car["points"][2 * used : 2 * (used + rows) : 2] = curve.x
            car["points"][2 * used + 1 : 2 * (used + rows) : 2] = curve.y
            used += rows
    system = axles[0].tables.steering_system
    if system is not None:
        car["steering_compliance"] = 1.0 / system.torsional_stiffness
        car["caster_trail"] = system.caster_trail
    lengths = car["axle"]["rows"]
    compliant = lengths[:, [TOE + 1, TOE + 2, CAMBER + 1, CAMBER + 2]].any()
    moving = float(lengths[:, TOE:STEERING].any())
    car["attitudes"] = COMPLIANT if compliant or system is not None else moving


def _curves(axle: Axle, ratio: float) -> Iterator[Curve | None]:
    """The curves in the order of their purposes, rebound damping over compression by ``ratio``."""
    curves = axle.curves
    scaled = {"spring": _spring(curves, axle.spring), "damper": _damper(axle, ratio)}
    for purpose in PURPOSES:
        curve = scaled.get(purpose, getattr(curves, purpose))
        yield None if purpose == "damper_ratio" and curves.damper is None else curve


def _spring(curves: WheelCurves, rate: float) -> Curve | None:
    curve = curves.spring
    if curve is None or rate == curves.rate:
        return curve
    rest, factor = curve(0.0), rate / curves.rate
    return Curve(curve.x, tuple(rest + factor * (force - rest) for force in curve.y))


def _damper(axle: Axle, more: float) -> Curve | None:
    curves, curve = axle.curves, axle.curves.damper
    if curve is None:
        return None
    compression, rebound = curves.damping
    ratio = rebound / compression * more
    wanted = 2.0 * axle.damping / (1.0 + ratio)
    factors = wanted / compression, wanted * ratio / rebound
    return Curve(
        curve.x,
        tuple(
            force * (factors[0] if speed > 0.0 else factors[1])
            for speed, force in zip(curve.x, curve.y, strict=True)
        ),
    )
