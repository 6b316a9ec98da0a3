"""The manoeuvres by name: path or steering, road, speed and length of each."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, pi

import numpy as np

from canroll.errors import CanrollError, UnknownNameError
from plant_sim import driver, path
from plant_sim.driver import Drive
from plant_sim.integrate import Vector
from vehicles import Vehicle

STEP_NS = 1_000_000
"""Time between two calls of the driver and two steps of the plant (ns)."""

YAW_LAG = 0.15
"""What a driver takes the car to need from the wheel to the lateral acceleration (s)."""

SLOWEST_KMH = 5.0
"""Slowest speed that the tyre and bicycle models make sense at (km/h)."""


@dataclass(frozen=True, slots=True)
class Maneuver:
    """One manoeuvre, ready to run once: ``drive`` holds the driver's memory.

    ``speed`` (m/s) at entry; ``standard`` says which standard it follows and where it departs.
    """

    name: str
    title: str
    standard: str
    speed: float
    duration_ns: int
    drive: Drive


@dataclass(frozen=True, slots=True)
class _Kind:
    title: str
    speed_kmh: float
    fastest_kmh: float
    standard: str
    make: Callable[..., tuple[float, Drive]]
    """(vehicle, speed, seed, **options) to duration (s) and drive."""


def understeer(vehicle: Vehicle) -> float:
    """Understeer gradient of the linear bicycle (rad per m/s²): δ = l/R + K a_y."""
    geometry, tyre = vehicle.geometry, vehicle.tyre
    return (
        vehicle.total_mass
        / geometry.wheelbase
        * (
            geometry.cg_to_rear_axle / tyre.cornering_stiffness_front
            - geometry.cg_to_front_axle / tyre.cornering_stiffness_rear
        )
    )


def make_drive(
    vehicle: Vehicle,
    *,
    kind: int,
    speed: float,
    path_xy: tuple[Vector, Vector] | None = None,
    table: Vector | None = None,
    table_step: float = STEP_NS * 1e-9,
    bank: Vector | None = None,
    road: tuple[Vector, Vector] | None = None,
    road_step: float = 1.0,
    friction: float = 1.0,
    release_time: float = inf,
    preview_time: float | None = None,
) -> Drive:
    """Collect what drives a manoeuvre into arrays for the kernels, with a fresh driver's memory.

    ``release_time`` (s): the accelerator is let go from then on. ``preview_time`` (s) replaces the
    vehicle's driver by one of another experience.
    """
    geometry, person = vehicle.geometry, vehicle.driver
    parameters = np.zeros(driver.N_DRIVER)
    parameters[driver.D_PREVIEW_TIME] = preview_time or person.preview_time
    parameters[driver.D_LAG] = person.lag
    parameters[driver.D_ACCELERATION_LIMIT] = person.lateral_acceleration_limit
    parameters[driver.D_WHEELBASE] = geometry.wheelbase
    parameters[driver.D_UNDERSTEER] = understeer(vehicle)
    parameters[driver.D_STEER_LIMIT] = vehicle.steering.angle_limit
    parameters[driver.D_STEER_RATE] = vehicle.steering.rate_limit
    parameters[driver.D_SPEED] = speed
    parameters[driver.D_SPEED_GAIN] = 2.0 * vehicle.total_mass
    parameters[driver.D_RELEASE_TIME] = release_time
    parameters[driver.D_PATH_STEP] = path.STEP
    parameters[driver.D_TABLE_STEP] = table_step
    parameters[driver.D_FRICTION] = friction
    parameters[driver.D_ROAD_STEP] = road_step
    parameters[driver.D_FRONT] = geometry.cg_to_front_axle
    parameters[driver.D_REAR] = geometry.cg_to_rear_axle
    parameters[driver.D_ANSWER_LAG] = person.lag + YAW_LAG
    parameters[driver.D_TIME_STEP] = STEP_NS * 1e-9
    x, y = path_xy if path_xy is not None else (np.array([0.0, path.STEP]), np.zeros(2))
    left, right = road if road is not None else (np.zeros(1), np.zeros(1))
    return Drive(
        kind=kind,
        parameters=parameters,
        path_x=x,
        path_y=y,
        table=np.zeros(1) if table is None else table,
        bank=np.zeros(1) if bank is None else bank,
        road_left=left,
        road_right=right,
        memory=np.zeros(driver.N_MEMORY),
    )


def _double_lane_change(
    vehicle: Vehicle, speed: float, _seed: int, *, preview_time: float | None = None
) -> tuple[float, Drive]:
    approach, run_out = 15.0, 15.0
    xy = path.double_lane_change(approach, vehicle.lane_offset, run_out + 3.0 * speed)
    drive = make_drive(
        vehicle, kind=driver.FOLLOW_PATH, speed=speed, path_xy=xy, preview_time=preview_time
    )
    length = approach + sum(path.DOUBLE_LANE_CHANGE_LENGTHS) + run_out
    return length / speed, drive


def _roundabout(
    vehicle: Vehicle, speed: float, _seed: int, *, preview_time: float | None = None
) -> tuple[float, Drive]:
    radius, approach, easing, turn = 22.0, 30.0, 8.0, pi
    arc = radius * turn - easing
    sections = [
        (approach, 0.0),
        (easing, 1 / radius),
        (arc, 1 / radius),
        (easing, 0.0),
        (approach + 3.0 * speed, 0.0),
    ]
    drive = make_drive(
        vehicle,
        kind=driver.FOLLOW_PATH,
        speed=speed,
        path_xy=path.from_curvature(sections),
        preview_time=preview_time,
    )
    return (2 * approach + 2 * easing + arc) / speed, drive


_KINDS: dict[str, _Kind] = {
    "double_lane_change": _Kind(
        "double lane change", 80.0, 160.0, "ISO 3888-1", _double_lane_change
    ),
    "roundabout": _Kind("roundabout of 22 m radius", 30.0, 120.0, "", _roundabout),
}


def names() -> list[str]:
    """The manoeuvres that :func:`build` knows, sorted."""
    return sorted(_KINDS)


def default_speed(name: str, vehicle: Vehicle) -> float:
    """Entry speed (m/s) of that manoeuvre: the vehicle's own where its file states one."""
    if name not in _KINDS:
        raise UnknownNameError("manoeuvre", name, _KINDS)
    return vehicle.speeds.get(name, _KINDS[name].speed_kmh / 3.6)


def build(
    name: str,
    vehicle: Vehicle,
    speed: float | None = None,
    seed: int = 0,
    *,
    preview_time: float | None = None,
) -> Maneuver:
    """Prepare one manoeuvre for one run.

    Parameters
    ----------
    name
        One of :func:`names`.
    speed
        Entry speed in m/s; by default that of the vehicle or the manoeuvre.
    seed
        Of what is random in the manoeuvre, the road.
    preview_time
        Driver's preview in s instead of the vehicle's: 0.5 experienced, 0.75, 1.0 novice.

    Raises
    ------
    UnknownNameError
        No manoeuvre has that name.
    CanrollError
        The speed is outside of what the manoeuvre can be driven at, or the preview of 0.3 to 3 s.
    """
    speed = default_speed(name, vehicle) if speed is None else speed
    kind = _KINDS[name]
    if not SLOWEST_KMH <= speed * 3.6 <= kind.fastest_kmh + 1e-6:
        raise CanrollError(
            f"speed {speed * 3.6:g} km/h: the {kind.title} is driven at "
            f"{SLOWEST_KMH:g} to {kind.fastest_kmh:g} km/h"
        )
    if preview_time is not None and not 0.3 <= preview_time <= 3.0:
        raise CanrollError(f"preview time {preview_time:g} s: a driver looks 0.3 to 3 s ahead")
    duration, drive = kind.make(vehicle, speed, seed, preview_time=preview_time)
    return Maneuver(
        name=name,
        title=kind.title,
        standard=kind.standard,
        speed=speed,
        duration_ns=round(duration * 1e9 / STEP_NS) * STEP_NS,
        drive=drive,
    )
