"""Manoeuvres of a driver on a path: lane changes, circles, straights over rough road.

Every function plans one manoeuvre from the vehicle, the entry speed (m/s), a seed for its random
part, and its own options.
"""

from math import pi, radians

import numpy as np

from canroll.errors import CanrollError
from plant_sim.driving import path, road
from plant_sim.driving.drive import GRIP_USED, ManeuverKind, ManeuverPlan
from plant_sim.driving.line import through_gates
from vehicles import GRAVITY, Vehicle

APPROACH = 15.0
"""Straight before the first lane of a cone track, and after the last (m)."""


OVERHANG = 0.9
"""Bodywork ahead of the front axle and behind the rear one (m)."""


def _line(vehicle: Vehicle, speed: float, lanes: tuple[path.Lane, ...], run_out: float) -> path.XY:
    geometry = vehicle.geometry
    return through_gates(
        lanes,
        approach=APPROACH,
        run_out=run_out,
        front=geometry.cg_to_front_axle + OVERHANG,
        rear=geometry.cg_to_rear_axle + OVERHANG,
        width=geometry.width,
        curvature=GRIP_USED * vehicle.tyre.friction * GRAVITY / speed**2,
    )


def double_lane_change(vehicle: Vehicle, speed: float, _seed: int) -> ManeuverPlan:
    """ISO 3888-1 at constant speed; the standard's lateral offset or the vehicle's own."""
    lanes = path.double_lane_change(vehicle.geometry.width, vehicle.lane_offset)
    end = lanes[-1].start + lanes[-1].length
    xy = _line(vehicle, speed, lanes, run_out=APPROACH + 3 * speed)
    return ManeuverPlan((2 * APPROACH + end) / speed, path_xy=xy)


def moose(vehicle: Vehicle, speed: float, _seed: int) -> ManeuverPlan:
    """ISO 3888-2: accelerator released 2 m into the first lane."""
    lanes = path.obstacle_avoidance(vehicle.geometry.width)
    end = lanes[-1].start + lanes[-1].length
    return ManeuverPlan(
        (2 * APPROACH + end) / speed + 2.0,
        path_xy=_line(vehicle, speed, lanes, run_out=120.0),
        release_time=(APPROACH + 2.0) / speed,
    )


def slalom(
    vehicle: Vehicle, speed: float, _seed: int, *, spacing: float = 18.0, count: float = 8.0
) -> ManeuverPlan:
    """Left and right of ``count`` cones in a row, half the car's width and 0.5 m from each."""
    cones = int(count)
    if count != cones:
        raise CanrollError(f"option count of slalom: {count:g} must be a whole number")
    amplitude = vehicle.geometry.width / 2 + 0.5
    run_up = APPROACH + spacing
    lanes = (
        path.Lane(0.0, 0.0, 0.0, 0.0),
        *(path.Lane(spacing * (k + 1), 0.0, amplitude * (-1) ** k, 0.0) for k in range(cones)),
        path.Lane(spacing * (cones + 1), 0.0, 0.0, 0.0),
    )
    xy = path.through(lanes, approach=APPROACH, run_out=APPROACH + 3 * speed)
    return ManeuverPlan((2 * run_up + spacing * cones) / speed, path_xy=xy)


def roundabout(_vehicle: Vehicle, speed: float, _seed: int) -> ManeuverPlan:
    """Half-way round a circle of 22 m radius, straight in and out, at constant speed."""
    radius, approach, easing = 22.0, 30.0, 8.0
    arc = radius * pi - easing
    sections = [
        (approach, 0.0),
        (easing, 1 / radius),
        (arc, 1 / radius),
        (easing, 0.0),
        (approach + 3.0 * speed, 0.0),
    ]
    return ManeuverPlan(
        (2 * approach + 2 * easing + arc) / speed,
        path_xy=path.from_curvature(sections),
    )


CIRCLE_DURATION = 12.0
"""How long a curve of constant radius is driven (s)."""


def _circle(radius: float, speed: float) -> path.XY:
    approach, easing = 10.0, max(10.0, speed)
    arc = (CIRCLE_DURATION + 3.0) * speed
    return path.from_curvature([(approach, 0.0), (easing, 1 / radius), (arc, 1 / radius)])


def constant_radius(
    _vehicle: Vehicle, speed: float, _seed: int, *, radius: float = 100.0
) -> ManeuverPlan:
    """ISO 4138 constant radius: on a circle to the left at constant speed."""
    return ManeuverPlan(CIRCLE_DURATION, path_xy=_circle(radius, speed), at_the_limit=True)


def banked_curve(
    _vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    radius: float = 150.0,
    bank_deg: float = -5.0,
) -> ManeuverPlan:
    """A left curve whose road banks with its curvature; a negative bank leans into the curve."""
    travelled = np.arange(0.0, CIRCLE_DURATION * speed + 10.0, 1.0)
    part = np.clip((travelled - 10.0) / max(10.0, speed), 0.0, 1.0)
    return ManeuverPlan(
        CIRCLE_DURATION, path_xy=_circle(radius, speed), bank=radians(bank_deg) * part
    )


def _straight(length: float) -> path.XY:
    x = np.arange(0.0, length, path.STEP)
    return x, np.zeros_like(x)


def bumps(
    _vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    height: float = 0.05,
    length: float = 1.5,
    spacing: float = 12.0,
    count: float = 4.0,
) -> ManeuverPlan:
    """Straight ahead over ``count`` bumps under the left wheels only; height and lengths in m."""
    if count != int(count):
        raise CanrollError(f"option count of bumps: {count:g} must be a whole number")
    left = road.bumps(height=height, length=length, spacing=spacing, count=int(count), start=20.0)
    distance = 20.0 + count * spacing + 2.0 * speed
    return ManeuverPlan(
        distance / speed,
        path_xy=_straight(distance + 5 * speed),
        road=(left, np.zeros_like(left)),
        road_step=road.STEP,
    )


def random_road(
    vehicle: Vehicle, speed: float, seed: int, *, road_class: str = "C", duration: float = 20.0
) -> ManeuverPlan:
    """Straight ahead on a road of an ISO 8608 class, A to E, for ``duration`` (s)."""
    geometry = vehicle.geometry
    distance = duration * speed + geometry.wheelbase + 10.0
    width = geometry.half_track_front + geometry.half_track_rear
    return ManeuverPlan(
        duration,
        path_xy=_straight(distance + 5 * speed),
        road=road.random_tracks(road_class, length=distance, track=width, seed=seed),
        road_step=road.STEP,
    )


DOUBLE_LANE_CHANGE = ManeuverKind(
    "double lane change", 80.0, 160.0, "ISO 3888-1", double_lane_change
)
"""Double lane change, ISO 3888-1."""
MOOSE = ManeuverKind("obstacle avoidance", 80.0, 100.0, "ISO 3888-2", moose, 0.6, True)
"""Obstacle avoidance, ISO 3888-2."""
SLALOM = ManeuverKind("slalom", 50.0, 120.0, "none", slalom)
"""Slalom round cones in a row."""
ROUNDABOUT = ManeuverKind("roundabout of 22 m radius", 30.0, 120.0, "none", roundabout)
"""Roundabout of 22 m radius."""
CONSTANT_RADIUS = ManeuverKind("constant radius", 60.0, 160.0, "ISO 4138", constant_radius)
"""Circle of constant radius, ISO 4138."""
BANKED_CURVE = ManeuverKind("banked curve", 80.0, 160.0, "none", banked_curve)
"""Curve on a banked road."""
BUMPS = ManeuverKind("one-sided bumps", 40.0, 120.0, "none", bumps)
"""Bumps under the wheels of one side."""
RANDOM_ROAD = ManeuverKind("random road", 80.0, 160.0, "ISO 8608", random_road)
"""Straight on over a rough road, ISO 8608."""
