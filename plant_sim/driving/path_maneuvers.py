"""Manoeuvres on a path: lane changes, circles, straights over rough or slippery road and in wind.

Every function plans one manoeuvre from the vehicle, the entry speed (m/s), a seed for its random
part, and its own options.
"""

from math import inf, pi, radians
from typing import Any

import numpy as np

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.driving import path, road
from canroll.plant_sim.driving.drive import GRIP_USED, ManeuverKind, ManeuverPlan, pedal
from canroll.plant_sim.driving.driver import STEER_TABLE
from canroll.plant_sim.driving.line import through_gates
from canroll.vehicles import GRAVITY, Vehicle

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


SIDES = ("left", "right", "both")
"""Wheels that bumps are under."""


def bumps(
    _vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    height: float = 0.05,
    length: float = 1.5,
    spacing: float = 12.0,
    count: float = 4.0,
    side: str = "left",
    shape: str = "cosine",
) -> ManeuverPlan:
    """Straight ahead over ``count`` bumps; height and lengths in m.

    Under the wheels of a ``side``, or ``both``; of a ``shape`` of :data:`road.SHAPES`.
    """
    if count != int(count):
        raise CanrollError(f"option count of bumps: {count:g} must be a whole number")
    if side not in SIDES:
        raise UnknownNameError("side of bumps", side, SIDES)
    profile = road.bumps(
        height=height,
        length=length,
        spacing=spacing,
        count=int(count),
        start=20.0,
        shape=shape,
    )
    level = np.zeros_like(profile)
    distance = 20.0 + count * spacing + 2.0 * speed
    return ManeuverPlan(
        distance / speed,
        path_xy=path.straight(distance + 5 * speed),
        road=(level if side == "right" else profile, level if side == "left" else profile),
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
        path_xy=path.straight(distance + 5 * speed),
        road=road.random_tracks(road_class, length=distance, track=width, seed=seed),
        road_step=road.STEP,
    )


BEFORE = 0.5
"""Straight running before a gust or the brakes (s)."""
AFTER = 2.5
"""Time after a gust (s)."""


def _straight_on(distance: float, *, driver: bool) -> dict[str, Any]:
    """What keeps a car straight over that distance (m): its driver, or a fixed steering wheel."""
    if driver:
        return {"path_xy": path.straight(distance)}
    return {"kind": STEER_TABLE, "table": np.zeros(1), "steer_rate": inf}


def crosswind(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    crosswind: float = 20.0,
    length: float = 30.0,
    driver: bool = False,
) -> ManeuverPlan:
    """ISO 12021: straight ahead past a wind generator, the steering wheel fixed or with a driver.

    ``crosswind`` (m/s), to the left if positive, over ``length`` (m). Its force grows as the car
    comes in and falls as it goes out.
    """
    geometry = vehicle.geometry
    begin = BEFORE * speed
    front, rear = geometry.cg_to_front_axle + OVERHANG, geometry.cg_to_rear_axle + OVERHANG
    edges = begin + front + np.array([-front, rear, length - front, length + rear])
    # a zone shorter than the car never blows on all of it
    edges[1:3], part = np.sort(edges[1:3]), min(1.0, length / (front + rear))
    duration = (float(edges[-1])) / speed + AFTER
    at = np.arange(0.0, float(edges[-1]) + 2 * road.STEP, road.STEP)
    return ManeuverPlan(
        duration,
        wind=np.interp(at, edges, crosswind * part * np.array([0.0, 1.0, 1.0, 0.0])),
        road_step=road.STEP,
        **_straight_on((duration + 5.0) * speed, driver=driver),
    )


def _braking(
    vehicle: Vehicle, speed: float, friction: tuple[float, float], braked: float, *, driver: bool
) -> ManeuverPlan:
    """Braking by ``braked`` (m/s²) from where the road has that friction, left and right."""
    begin = BEFORE * speed
    wheels = vehicle.geometry.cg_to_front_axle
    at = np.arange(0.0, begin + wheels + 2 * road.STEP, road.STEP)
    changed = np.interp(at, [begin + wheels, begin + wheels + road.STEP], [0.0, 1.0])
    grip = 0.5 * sum(friction) * vehicle.tyre.friction * GRAVITY
    duration = BEFORE + (speed - min(STOPPED, 0.5 * speed)) / min(braked, grip)
    return ManeuverPlan(
        duration,
        friction=tuple(1.0 + (side - 1.0) * changed for side in friction),
        road_step=road.STEP,
        release_time=BEFORE,
        pedal=pedal(-braked),
        **_straight_on((duration + 5.0) * speed, driver=driver),
    )


STOPPED = 10.0 / 3.6
"""Speed (m/s) at which braking on a straight ends."""


def split_friction(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    friction_left: float = 1.0,
    friction_right: float = 0.3,
    deceleration: float = 5.0,
    driver: bool = False,
) -> ManeuverPlan:
    """ISO 14512: braking on a road that is slippery on one side; no anti-lock control.

    The frictions are in multiples of the option ``friction``; ``deceleration`` (m/s²) is what the
    brakes would give on dry road.
    """
    return _braking(vehicle, speed, (friction_left, friction_right), deceleration, driver=driver)


def friction_jump(
    vehicle: Vehicle,
    speed: float,
    _seed: int,
    *,
    friction_after: float = 0.3,
    deceleration: float = 5.0,
    driver: bool = False,
) -> ManeuverPlan:
    """Braking at the place from where on the road is slippery; no anti-lock control."""
    return _braking(vehicle, speed, (friction_after,) * 2, deceleration, driver=driver)


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
BUMPS = ManeuverKind("bumps", 40.0, 120.0, "none", bumps)
"""Bumps under the wheels of one side or both, one or several."""
CROSSWIND = ManeuverKind("crosswind gust", 100.0, 200.0, "ISO 12021", crosswind)
"""Crosswind gust, ISO 12021."""
SPLIT_FRICTION = ManeuverKind("braking on split friction", 80.0, 160.0, "ISO 14512", split_friction)
"""Braking on split friction, ISO 14512."""
FRICTION_JUMP = ManeuverKind("braking on a friction jump", 80.0, 160.0, "none", friction_jump)
"""Braking at a jump of friction."""
RANDOM_ROAD = ManeuverKind("random road", 80.0, 160.0, "ISO 8608", random_road)
"""Straight on over a rough road, ISO 8608."""
