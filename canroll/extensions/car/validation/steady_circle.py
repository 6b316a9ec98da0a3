"""A steady circle (ISO 4138), judged in the manner of ISO 19364.

Steering-wheel angle, sideslip and roll are plotted over the lateral acceleration. The tolerance is
a band about the simulated curve, in both directions, and measured points must be inside, as far as
both cars get. Points are means over bins of the lateral acceleration. The band is what an ellipse
covers, whose half-axes are the tolerances of both axes and whose centre moves along the curve.

Both cars are steered alike, so that they drive circles of different radius. Plotted are steering
and sideslip beyond those of the geometry, i l r/v and l_r r/v, which depend on the lateral
acceleration alone. That is v r, horizontal whatever the axes of the inertial unit. A steering with
a table is shown as one of its ratio on centre that turns the road wheels alike.
"""

from collections.abc import Mapping
from math import degrees

import numpy as np

from canroll.errors import CanrollError, VerdictError
from canroll.extensions.car.identification.pieces import RUN_IN, SAMPLE
from canroll.extensions.car.validation.criterion import Criterion, Judged, ToleranceBand
from canroll.extensions.car.validation.replayed import Drive
from canroll.extensions.car.validation.tolerances import FACTORS, Tolerance
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.axles import road_wheel_curve, road_wheels

SETTLING = 3.0
"""First part of a stretch (s) in which the simulated car, which begins straight, gets there."""
BIN = 0.5
"""Width of a bin of the lateral acceleration (m/s²)."""
LEAST = 20
"""A bin with fewer samples has no point."""
LINEAR = 4.0
"""Lateral acceleration (m/s²) up to which gradients are fitted."""
LINE = 200
"""Points of a boundary that is drawn."""
_QUANTITIES = {
    "steering": "steering beyond geometry",
    "sideslip": "sideslip beyond geometry",
    "roll": "roll",
}


class _States:
    """Means of a car on the circle over bins of its lateral acceleration, of both signs."""

    def __init__(self, lateral: Vector, values: Mapping[str, Vector]) -> None:
        places = np.round(lateral / BIN).astype(int)
        bins = [b for b in np.unique(places) if np.sum(places == b) >= LEAST]
        self.lateral = np.array([lateral[places == b].mean() for b in bins])
        self.values = {
            name: np.array([column[places == b].mean() for b in bins])
            for name, column in values.items()
        }


def judge(drive: Drive, tolerances: Mapping[str, Tolerance]) -> Judged:
    """Compare the steady states of a drive.

    Raises:
        CanrollError: no steady state in the log, or no yaw rate.
    """
    if "yaw_rate" not in drive.names:
        raise CanrollError(
            f"{drive.log}: a steady circle is compared over speed × yaw rate, and it has no yaw "
            "rate: choose another --manoeuvre"
        )
    measured, simulated = _states(drive, simulated=False), _states(drive, simulated=True)
    if not measured.lateral.size or not simulated.lateral.size:
        raise CanrollError(
            f"{drive.log}: no steady state after {SETTLING:g} s: choose another --manoeuvre"
        )
    across = tolerances["circle.lateral_acceleration"]
    bands = tuple(
        _band(name, measured, simulated, across, tolerances[f"circle.{name}"])
        for name in _QUANTITIES
        if name in measured.values
    )
    return Judged(tuple(_gradients(drive, measured, simulated)), bands)


def _states(drive: Drive, *, simulated: bool) -> _States:
    names = ["yaw_rate", *(name for name in ("sideslip", "roll") if name in drive.names)]
    columns: dict[str, list[Vector]] = {name: [] for name in (*names, "steering", "speed")}
    for stretch in drive.stretches:
        there = stretch.inside.copy()
        there[: round((SETTLING + RUN_IN) / SAMPLE)] = False
        for name in names:
            there &= np.isfinite(stretch.measured[name])
        signals = stretch.simulated if simulated else stretch.measured
        columns["steering"].append(stretch.steering[there])
        columns["speed"].append(stretch.speed[there])
        for name in names:
            columns[name].append(signals[name][there])
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    car, speed, yaw_rate = drive.vehicle, joined.pop("speed"), joined.pop("yaw_rate")
    curvature = yaw_rate / speed
    joined["steering"] = (
        _by_ratio_on_centre(car, joined["steering"])
        - car.steering.ratio * car.geometry.wheelbase * curvature
    )
    if "sideslip" in joined:
        joined["sideslip"] = joined["sideslip"] - car.geometry.cg_to_rear_axle * curvature
    return _States(speed * yaw_rate, joined)


def _by_ratio_on_centre(car: Vehicle, angles: Vector) -> Vector:
    """Return the angles of a steering wheel of constant ratio that turn the road wheels alike."""
    if road_wheel_curve(car) is None:
        return angles
    ratio = car.steering.ratio
    return np.array([ratio * road_wheels(car, float(angle) / ratio) for angle in angles])


def _gradients(drive: Drive, measured: _States, simulated: _States) -> list[Criterion]:
    """What both cars reach, and gradients up to :data:`LINEAR`: shown, not judged."""
    car, both = drive.vehicle, (measured, simulated)
    real, ours = (float(np.abs(states.lateral).max()) for states in both)
    result = [Criterion("largest lateral acceleration", real, ours, "m/s²", np.inf)]
    linear = [np.abs(states.lateral) <= LINEAR for states in both]
    if any(
        there.sum() < 3 or np.ptp(states.lateral[there]) < 2 * BIN
        for states, there in zip(both, linear, strict=True)
    ):
        return result
    for label, name in (
        ("understeer gradient", "steering"),
        ("roll gradient", "roll"),
        ("sideslip gradient", "sideslip"),
    ):
        if name not in measured.values:
            continue
        slopes = []
        for states, there in zip(both, linear, strict=True):
            values = states.values[name]
            if name == "steering":
                values = values / car.steering.ratio
            slopes.append(degrees(np.polyfit(states.lateral[there], values[there], 1)[0]) * GRAVITY)
        result.append(Criterion(label, slopes[0], slopes[1], "°/g", np.inf))
    return result


def _band(
    name: str, measured: _States, simulated: _States, across: Tolerance, along: Tolerance
) -> ToleranceBand:
    x, y = simulated.lateral, simulated.values[name]
    reach = across.along(x)
    inside = (measured.lateral >= (x - reach).min()) & (measured.lateral <= (x + reach).max())
    if not inside.any():
        raise VerdictError("the simulated car reaches no lateral acceleration of the measured one")
    points = measured.lateral[inside], measured.values[name][inside]
    far = distances(points, (x, y), across, along)
    worst = int(np.argmax(far))
    lower, upper = boundaries(x, y, across, along)
    factor = 1.0 / FACTORS["°"]
    title = _QUANTITIES[name]
    return ToleranceBand(
        name,
        f"{title} over lateral acceleration".capitalize(),
        "lateral acceleration (m/s²)",
        "°",
        (points[0], factor * points[1]),
        (x, factor * y),
        (lower[0], factor * lower[1]),
        (upper[0], factor * upper[1]),
        float(far[worst]),
        float(points[0][worst]),
    )


def distances(
    points: tuple[Vector, Vector],
    line: tuple[Vector, Vector],
    across: Tolerance,
    along: Tolerance,
) -> Vector:
    """Return the distance of points, x and y (n,), from a line through others (m,), in tolerances.

    At every point of the line the tolerances of x and y are the half-axes of an ellipse; a point
    within one has a distance of at most 1.
    """
    x, y = _fine(*line)
    dx = (points[0][:, None] - x) / across.along(x)
    dy = (points[1][:, None] - y) / along.along(y)
    return np.asarray(np.sqrt(np.min(dx**2 + dy**2, axis=1)))


def _fine(x: Vector, y: Vector) -> tuple[Vector, Vector]:
    """Return the line with :data:`LINE` points in each of its parts."""
    if len(x) == 1:
        return x, y
    at = np.linspace(0.0, len(x) - 1.0, LINE * (len(x) - 1) + 1)
    return np.interp(at, np.arange(len(x)), x), np.interp(at, np.arange(len(y)), y)


def boundaries(
    x: Vector, y: Vector, across: Tolerance, along: Tolerance
) -> tuple[tuple[Vector, Vector], tuple[Vector, Vector]]:
    """Return the lower and the upper boundary of the band about a line, each x and y.

    The envelope of the ellipses: where their tangent is parallel to the line.
    """
    a, b = across.along(x), along.along(y)
    if len(x) == 1:
        turn = np.linspace(0.0, np.pi, 60)
        half = x + a * np.cos(turn), b * np.sin(turn)
        return (half[0], y - half[1]), (half[0], y + half[1])
    dx, dy = np.gradient(x), np.gradient(y)
    size = np.hypot(dx * b, dy * a)
    shift_x, shift_y = -dy * a**2 / size, dx * b**2 / size
    return (x - shift_x, y - shift_y), (x + shift_x, y + shift_y)
