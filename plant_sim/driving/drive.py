"""The inputs of a manoeuvre as arrays for the driver kernel."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

import numpy as np

from canroll.plant_sim.driving import driver, path, preview
from canroll.plant_sim.driving.driver import DRIVER, FOLLOW_PATH, MEMORY, DriveInputs
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.typing import Vector
from canroll.vehicles import Vehicle
from canroll.vehicles.axles import Axle, axles

GRIP_USED = 0.85
"""Share of the tyres' peak that a driver goes up to."""


@dataclass(frozen=True, slots=True)
class ManeuverPlan:
    """Contents of one manoeuvre, independent of road and driver.

    ``duration`` (s). ``table`` at steps of ``table_step`` (s): road-wheel angle (rad) or lateral
    acceleration (m/s²). ``speed`` (m/s), one value per STEP_NS, the first at entry, replaces the
    constant one. ``bank`` and ``grade`` (rad), ``road``, the heights (m) under the left and the
    right wheels, ``friction`` there, in multiples of the option, and ``wind``, along the world's y
    axis (m/s), at steps of ``road_step`` (m) of distance. ``release_time`` (s): the accelerator is
    released from then on, and ``pedal`` (m/s², one value per STEP_NS from then on) is the
    acceleration that accelerator and brake ask for; None: 0. ``steer_rate`` (rad/s at the road
    wheels) other than 0 replaces the driver's arms by a steering robot. ``at_the_limit``: the
    driver turns the wheel beyond the peak of the front tyres. ``fishhook``: start (s), amplitude
    (rad), hold (s), return (s). ``remarks``: what was left out of a file.
    """

    duration: float
    kind: int = FOLLOW_PATH
    path_xy: path.XY | None = None
    table: Vector | None = None
    table_step: float = STEP_NS * 1e-9
    speed: Vector | None = None
    bank: Vector | None = None
    grade: Vector | None = None
    road: tuple[Vector, Vector] | None = None
    friction: tuple[Vector, Vector] | None = None
    wind: Vector | None = None
    road_step: float = 1.0
    release_time: float = inf
    pedal: Vector | None = None
    steer_rate: float = 0.0
    at_the_limit: bool = False
    fishhook: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ManeuverKind:
    """A kind of manoeuvre, for any vehicle and speed.

    ``plan(vehicle, speed, seed, **options)`` gives the plan; ``standard`` is the one it follows.
    """

    title: str
    speed_kmh: float
    fastest_kmh: float
    standard: str
    plan: Callable[..., ManeuverPlan]
    friction: float = 1.0
    chassis_control: bool = False


PEDAL_TIME = 0.2
"""Time in which a pedal is pressed or released (s)."""


def pedal(acceleration: float) -> Vector:
    """An acceleration (m/s²) that the pedals ask for from the release of the accelerator on."""
    return acceleration * np.linspace(0.0, 1.0, round(PEDAL_TIME * 1e9 / STEP_NS) + 1)


def steady_steer(vehicle: Vehicle, speed: float, lateral_acceleration: float) -> float:
    """Road-wheel angle (rad) at which the linear car corners at that acceleration (m/s²)."""
    return lateral_acceleration * (vehicle.geometry.wheelbase / speed**2 + vehicle.understeer)


def slip_limit(axle: Axle, friction: float) -> float:
    """Slip angle (rad) at which a Fiala tyre of the axle has GRIP_USED of its peak.

    F = µ F_z (1 - (1 - x / 3)³) with x = C α / (µ F_z).
    """
    grip = 2.0 * axle.tyre.grip(axle.wheel_load, friction)
    part = 3.0 * (1.0 - float(np.cbrt(1.0 - GRIP_USED)))
    return part * grip / axle.cornering


def make_drive(
    vehicle: Vehicle,
    speed: float,
    plan: ManeuverPlan,
    *,
    friction: float = 1.0,
    preview_time: float = 0.0,
    chassis_control: bool = False,
) -> DriveInputs:
    """Arrays for the kernels, with a new driver's memory; ``speed`` in m/s.

    A ``preview_time`` (s) of 0 is that of :func:`canroll.plant_sim.driving.preview.preview_time`.
    """
    front, rear = axles(vehicle)
    air, geometry = vehicle.side_wind, vehicle.geometry
    middle = 0.5 * (geometry.cg_to_front_axle - geometry.cg_to_rear_axle)
    gains, ahead = np.zeros(2 * driver.ROW), 0.0
    if plan.kind == FOLLOW_PATH:
        ahead = preview_time or preview.preview_time(vehicle, speed)
        gains = preview.table(vehicle, speed, ahead)
    numbers = {
        "preview_time": ahead,
        "lag": vehicle.driver.lag,
        "slip_limit": np.inf if plan.at_the_limit else slip_limit(front, friction),
        "wheelbase": geometry.wheelbase,
        "understeer": vehicle.understeer,
        "steer_limit": vehicle.steering.angle_limit,
        "steer_rate": plan.steer_rate or vehicle.steering.rate_limit,
        "release_time": plan.release_time,
        "table_step": plan.table_step,
        "road_step": plan.road_step,
        "friction": friction,
        "front": front.ahead,
        "rear": -rear.ahead,
        **dict(zip(("start", "amplitude", "hold", "back"), plan.fishhook, strict=True)),
        "chassis_control": float(chassis_control),
        "mass": vehicle.total_mass,
        "yaw_inertia": vehicle.mass.yaw_inertia,
        "track": front.half_track,
        "cornering": front.cornering,
        "cg_height": vehicle.cg_height,
        "wind_factor": air.force_factor,
        "wind_ahead": air.centre_of_pressure_ahead + middle,
        "wind_height": air.centre_of_pressure_height,
    }
    tables = {name: getattr(plan, name) for name in ("table", "bank", "grade", "wind", "pedal")}
    tables["speed"] = np.array([speed]) if plan.speed is None else plan.speed
    straight, dry = (np.array([0.0, path.STEP]), np.zeros(2)), (np.ones(1), np.ones(1))
    for names, given, neutral in (
        (("path_x", "path_y"), plan.path_xy, straight),
        (("road_left", "road_right"), plan.road, (None, None)),
        (("friction_left", "friction_right"), plan.friction, dry),
    ):
        tables |= zip(names, neutral if given is None else given, strict=True)
    return DriveInputs(
        kind=plan.kind,
        parameters=np.array([tuple(numbers[name] for name in DRIVER.names or ())], DRIVER),
        preview=gains,
        memory=np.zeros(1, MEMORY),
        **{name: np.zeros(1) if table is None else table for name, table in tables.items()},
    )
