"""Manoeuvres that a driver steers along a path: lane changes, circles, straights over bad road."""

from math import pi, radians

import numpy as np

from plant_sim import path, road
from plant_sim.drive_setup import Made, make_drive
from plant_sim.driver import FOLLOW_PATH
from vehicles import Vehicle

APPROACH = 15.0
"""Straight before the first lane of a cone track, and after the last (m)."""


def double_lane_change(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    friction: float = 1.0,
    preview_time: float = 0.0,
    chassis_control: bool = False,
) -> Made:
    """ISO 3888-1 at held speed; the standard's lateral offset unless the vehicle states its own."""
    lanes = path.double_lane_change(vehicle.geometry.width, vehicle.lane_offset)
    end = lanes[-1].start + lanes[-1].length
    xy = path.through(lanes, approach=APPROACH, run_out=APPROACH + 3 * speed)
    drive = make_drive(
        vehicle,
        kind=FOLLOW_PATH,
        speed=speed,
        path_xy=xy,
        friction=friction,
        preview_time=preview_time,
        chassis_control=chassis_control,
    )
    return (2 * APPROACH + end) / speed, drive


def moose(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    friction: float = 0.6,
    preview_time: float = 0.0,
    chassis_control: bool = True,
) -> Made:
    """ISO 3888-2: accelerator released 2 m into the first lane."""
    lanes = path.obstacle_avoidance(vehicle.geometry.width)
    end = lanes[-1].start + lanes[-1].length
    xy = path.through(lanes, approach=APPROACH, run_out=120.0)
    drive = make_drive(
        vehicle,
        kind=FOLLOW_PATH,
        speed=speed,
        path_xy=xy,
        friction=friction,
        preview_time=preview_time,
        chassis_control=chassis_control,
        release_time=(APPROACH + 2.0) / speed,
    )
    return (2 * APPROACH + end) / speed + 2.0, drive


def roundabout(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    friction: float = 1.0,
    preview_time: float = 0.0,
    chassis_control: bool = False,
) -> Made:
    """Half way round a circle of 22 m radius, straight in and out, at held speed.

    Entered faster than the driver would dare to take it, the wheel is turned after the circle all
    the same.
    """
    radius, approach, easing = 22.0, 30.0, 8.0
    arc = radius * pi - easing
    sections = [
        (approach, 0.0),
        (easing, 1 / radius),
        (arc, 1 / radius),
        (easing, 0.0),
        (approach + 3.0 * speed, 0.0),
    ]
    drive = make_drive(
        vehicle,
        kind=FOLLOW_PATH,
        speed=speed,
        path_xy=path.from_curvature(sections),
        friction=friction,
        preview_time=preview_time,
        chassis_control=chassis_control,
        at_the_limit=speed**2 / radius > vehicle.driver.lateral_acceleration_limit,
    )
    return (2 * approach + 2 * easing + arc) / speed, drive


def _circle(radius: float, speed: float, length: float) -> path.XY:
    approach, easing = 10.0, max(10.0, speed)
    sections = [(approach, 0.0), (easing, 1 / radius), (length + 3.0 * speed, 1 / radius)]
    return path.from_curvature(sections)


def constant_radius(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    radius: float = 100.0,
    friction: float = 1.0,
    preview_time: float = 0.0,
) -> Made:
    """ISO 4138 constant radius: on a circle to the left at held speed, for 12 s."""
    duration = 12.0
    drive = make_drive(
        vehicle,
        kind=FOLLOW_PATH,
        speed=speed,
        path_xy=_circle(radius, speed, duration * speed),
        friction=friction,
        preview_time=preview_time,
        at_the_limit=True,
    )
    return duration, drive


def banked_curve(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    radius: float = 150.0,
    bank_deg: float = -5.0,
    friction: float = 1.0,
    preview_time: float = 0.0,
) -> Made:
    """A left curve whose road banks with its curvature; a negative bank leans into the curve."""
    duration = 12.0
    travelled = np.arange(0.0, duration * speed + 10.0, 1.0)
    part = np.clip((travelled - 10.0) / max(10.0, speed), 0.0, 1.0)
    drive = make_drive(
        vehicle,
        kind=FOLLOW_PATH,
        speed=speed,
        path_xy=_circle(radius, speed, duration * speed),
        bank=radians(bank_deg) * part,
        friction=friction,
        preview_time=preview_time,
    )
    return duration, drive


def _straight(length: float) -> path.XY:
    x = np.arange(0.0, length, path.STEP)
    return x, np.zeros_like(x)


def bumps(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    height: float = 0.05,
    length: float = 1.5,
    spacing: float = 12.0,
    friction: float = 1.0,
) -> Made:
    """Straight ahead over four bumps under the left wheels only; height and lengths in m."""
    left = road.bumps(height=height, length=length, spacing=spacing, count=4, start=20.0)
    distance = 20.0 + 4 * spacing + 2.0 * speed
    drive = make_drive(
        vehicle,
        kind=FOLLOW_PATH,
        speed=speed,
        path_xy=_straight(distance + 5 * speed),
        road=(left, np.zeros_like(left)),
        road_step=road.STEP,
        friction=friction,
    )
    return distance / speed, drive


def random_road(
    vehicle: Vehicle,
    speed: float,
    seed: int,
    *,
    road_class: str = "C",
    duration: float = 20.0,
    friction: float = 1.0,
) -> Made:
    """Straight ahead on a road of an ISO 8608 class, A to E, for ``duration`` (s)."""
    distance = duration * speed + vehicle.geometry.wheelbase + 10.0
    width = vehicle.geometry.half_track_front + vehicle.geometry.half_track_rear
    tracks = road.random_tracks(road_class, length=distance, track=width, seed=seed)
    drive = make_drive(
        vehicle,
        kind=FOLLOW_PATH,
        speed=speed,
        path_xy=_straight(distance + 5 * speed),
        road=tracks,
        road_step=road.STEP,
        friction=friction,
    )
    return duration, drive
