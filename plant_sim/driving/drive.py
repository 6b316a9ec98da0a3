"""The inputs of a manoeuvre as arrays for the driver kernel."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

import numpy as np

from canroll.typing import Vector
from plant_sim.driving import driver, path, preview
from plant_sim.driving.driver import FOLLOW_PATH, DriveInputs
from plant_sim.kernels.instants import STEP_NS
from vehicles import Vehicle
from vehicles.axles import Axle, axles

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

    A ``preview_time`` (s) of 0 is that of :func:`plant_sim.driving.preview.preview_time`.
    """
    geometry, gains = vehicle.geometry, np.zeros(2 * driver.ROW)
    front, rear = axles(vehicle)
    p = np.zeros(driver.N_DRIVER)
    if plan.kind == FOLLOW_PATH:
        preview_time = preview_time or preview.preview_time(vehicle, speed)
        gains = preview.table(vehicle, speed, preview_time)
        p[driver.D_PREVIEW_TIME] = preview_time
    p[driver.D_LAG] = vehicle.driver.lag
    p[driver.D_SLIP_LIMIT] = np.inf if plan.at_the_limit else slip_limit(front, friction)
    p[driver.D_WHEELBASE] = geometry.wheelbase
    p[driver.D_UNDERSTEER] = vehicle.understeer
    p[driver.D_STEER_LIMIT] = vehicle.steering.angle_limit
    p[driver.D_STEER_RATE] = plan.steer_rate or vehicle.steering.rate_limit
    p[driver.D_RELEASE_TIME] = plan.release_time
    p[driver.D_PATH_STEP] = path.STEP
    p[driver.D_TABLE_STEP] = plan.table_step
    p[driver.D_FRICTION] = friction
    p[driver.D_ROAD_STEP] = plan.road_step
    p[driver.D_FRONT] = front.ahead
    p[driver.D_REAR] = -rear.ahead
    p[driver.D_TIME_STEP] = STEP_NS * 1e-9
    p[[driver.D_START, driver.D_AMPLITUDE, driver.D_HOLD, driver.D_RETURN]] = plan.fishhook
    p[driver.D_CHASSIS_CONTROL] = float(chassis_control)
    p[driver.D_MASS] = vehicle.total_mass
    p[driver.D_YAW_INERTIA] = vehicle.mass.yaw_inertia
    p[driver.D_TRACK] = front.half_track
    p[driver.D_CORNERING] = front.cornering
    p[driver.D_CG_HEIGHT] = vehicle.cg_height
    air = vehicle.side_wind
    middle = 0.5 * (geometry.cg_to_front_axle - geometry.cg_to_rear_axle)
    p[driver.D_WIND_FACTOR] = air.force_factor
    p[driver.D_WIND_AHEAD] = air.centre_of_pressure_ahead + middle
    p[driver.D_WIND_HEIGHT] = air.centre_of_pressure_height
    x, y = plan.path_xy if plan.path_xy is not None else (np.array([0.0, path.STEP]), np.zeros(2))
    left, right = plan.road if plan.road is not None else (np.zeros(1), np.zeros(1))
    grip_left, grip_right = plan.friction if plan.friction is not None else (np.ones(1), np.ones(1))
    return DriveInputs(
        kind=plan.kind,
        parameters=p,
        path_x=x,
        path_y=y,
        table=np.zeros(1) if plan.table is None else plan.table,
        speed=np.array([speed]) if plan.speed is None else plan.speed,
        bank=np.zeros(1) if plan.bank is None else plan.bank,
        road_left=left,
        road_right=right,
        grade=np.zeros(1) if plan.grade is None else plan.grade,
        friction_left=grip_left,
        friction_right=grip_right,
        wind=np.zeros(1) if plan.wind is None else plan.wind,
        pedal=np.zeros(1) if plan.pedal is None else plan.pedal,
        preview=gains,
        memory=np.zeros(driver.N_MEMORY),
    )
