"""Comparison of the 14-DOF plant and the multi-body car under the same steering."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.ports import initial_inputs
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.world.open_loop import advance, run_passive
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle
from support.multi_body import STEP, Motion, light_wheel

NONLINEAR = bodies.body("nonlinear")
SUBSTEPS = 10
"""Steps of our plant in one of the table: the multi-body car's tyres have no relaxation, ours as
little as such a step allows."""

RELAXATION = 2e-3
DRIVABLE_RELAXATION = 0.1
"""Relaxation lengths (m): of the comparison, and of the car that the driver steers at 1 ms."""


@dataclass(frozen=True, slots=True)
class Case:
    """A steering table (rad, one value per millisecond) at an entry speed (m/s).

    ``moments`` (n, 2) are anti-roll moments of front and rear axle (N·m).
    """

    name: str
    speed: float
    steer: Vector
    moments: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class Difference:
    """RMS of the difference relative to that of the multi-body car; for loads, of their change."""

    yaw_rate: float
    roll: float
    lateral_acceleration: float
    loads: float


def in_common(vehicle: Vehicle) -> Vehicle:
    """Return ``vehicle`` restricted to the features of the multi-body car.

    Tyres linear in load with one stiffness per load, dampers linear, no stops, no rolling
    resistance; unsprung masses in balance about the CG; wheels so light that they hardly resist
    being turned, since those of the multi-body car are no gyroscopes.
    """
    geometry, mass = vehicle.geometry, vehicle.mass
    front = geometry.static_front_share
    unsprung = mass.unsprung_front + mass.unsprung_rear
    tyre = vehicle.tyre
    cornering = tyre.cornering_stiffness_front + tyre.cornering_stiffness_rear
    return replace(
        vehicle,
        mass=replace(mass, unsprung_front=front * unsprung, unsprung_rear=(1 - front) * unsprung),
        suspension=replace(
            vehicle.suspension,
            rebound_bump_ratio=1.0,
            high_speed_ratio=1.0,
            bump_clearance=1.0,
            rebound_clearance=1.0,
        ),
        tyre=replace(
            tyre,
            cornering_stiffness_front=front * cornering,
            cornering_stiffness_rear=(1 - front) * cornering,
            friction_load_slope=0.0,
            cornering_load_slope=0.0,
            vertical_damping=0.0,
            rolling_resistance=0.0,
            relaxation_length=RELAXATION,
            wheel_inertia=light_wheel(tyre, STEP / SUBSTEPS),
        ),
    )


def lane_change(vehicle: Vehicle, speed_kmh: float) -> Case:
    """ISO 3888-1 as the project's driver steers ``vehicle`` through it."""
    tyre = vehicle.tyre
    drivable = replace(
        vehicle,
        tyre=replace(
            tyre,
            relaxation_length=max(tyre.relaxation_length, DRIVABLE_RELAXATION),
            wheel_inertia=max(tyre.wheel_inertia, light_wheel(tyre, STEP)),
        ),
    )
    maneuver = maneuvers.build("double_lane_change", drivable, speed_kmh / 3.6)
    steer = run_passive(drivable, NONLINEAR, maneuver)[1]
    return Case(f"double lane change, {speed_kmh:g} km/h", speed_kmh / 3.6, steer)


def step(angle_deg: float = 2.0, speed_kmh: float = 80.0) -> Case:
    """A step of the road wheels after half a second."""
    steer = np.where(np.arange(4000) < 500, 0.0, np.radians(angle_deg))
    return Case(f"step of {angle_deg:g}°, {speed_kmh:g} km/h", speed_kmh / 3.6, steer)


def sine(hertz: float, angle_deg: float = 1.0, speed_kmh: float = 80.0) -> Case:
    """Five seconds of a sine that grows over the first."""
    time = np.arange(5000) * STEP
    steer = np.radians(angle_deg) * np.sin(2 * np.pi * hertz * time) * np.minimum(time, 1.0)
    name = f"sine of {angle_deg:g}° and {hertz:g} Hz, {speed_kmh:g} km/h"
    return Case(name, speed_kmh / 3.6, steer)


def moment_sine(
    vehicle: Vehicle, hertz: float, size: float = 1000.0, speed_kmh: float = 80.0
) -> Case:
    """Five seconds of a sine moment (N·m) in straight running, split between the axles by load."""
    time = np.arange(5000) * STEP
    moment = size * np.sin(2 * np.pi * hertz * time) * np.minimum(time, 1.0)
    front = vehicle.geometry.static_front_share
    name = f"moment of {size:g} N·m and {hertz:g} Hz, {speed_kmh:g} km/h"
    return Case(name, speed_kmh / 3.6, np.zeros(time.size), np.outer(moment, (front, 1.0 - front)))


def cases(vehicle: Vehicle) -> Iterator[Case]:
    """Yield all cases for ``vehicle``."""
    yield from (lane_change(vehicle, speed) for speed in (60.0, 80.0, 100.0))
    yield step()
    yield from (sine(hertz) for hertz in (0.5, 1.0, 2.0, 3.0))
    yield from (moment_sine(vehicle, hertz) for hertz in (0.5, 1.0, 3.0, 5.0))


def drive_plant(vehicle: Vehicle, case: Case) -> Motion:
    """Drive the 14-DOF plant through ``case``, coasting."""
    state, parameters = NONLINEAR.build(vehicle, case.speed)
    inputs, outputs = initial_inputs(), np.zeros(ports.N_OUTPUTS)
    rows = np.empty((case.steer.size, ports.N_OUTPUTS))
    for i, angle in enumerate(case.steer):
        inputs[ports.STEER] = angle
        if case.moments is not None:
            inputs[[ports.BAR_MOMENT_FRONT, ports.BAR_MOMENT_REAR]] = case.moments[i]
        for _ in range(SUBSTEPS):
            advance(NONLINEAR.step, state, inputs, parameters, outputs, STEP / SUBSTEPS)
        rows[i] = outputs
    loads = rows[:, ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4]
    return Motion(
        rows[:, ports.YAW_RATE],
        rows[:, ports.ROLL],
        rows[:, ports.AY],
        loads,
        rows[:, ports.VX],
        np.arctan2(rows[:, ports.VY], rows[:, ports.VX]),
        rows[:, ports.ROLL_RATE],
        rows[:, ports.BODY_ACC + 1],
    )


def difference(ours: Motion, theirs: Motion) -> Difference:
    """Return the difference of the plant's motion from the multi-body car's."""

    def share(of: str) -> float:
        mine, other = getattr(ours, of), getattr(theirs, of)
        change = other - other[0] if of == "loads" else other
        return float(np.sqrt(np.mean((mine - other) ** 2) / np.mean(change**2)))

    return Difference(*(share(of.name) for of in fields(Difference)))


def balance(
    vehicle: Vehicle, motion: Motion, *, wheel_inertia: float
) -> tuple[float, float, float]:
    """Return the moments on the car about the line between its wheels at the end of a steady case.

    Args:
        vehicle: the car.
        motion: its motion.
        wheel_inertia: of a wheel that is a gyroscope (kg·m²); 0 of the multi-body car's.

    Returns:
        transferred: moment of the wheel loads (N·m).
        required: by the force balance of the whole car at small angles: m a_y at the CG's height,
            the weight of body and axles beside that line, and what turns the spinning wheels.
        unbalanced: part neglected by a car whose springs push on axles along the body's vertical
            without a moment arm (N·m).
    """
    geometry, plant, tyre = vehicle.geometry, vehicle.plant, vehicle.tyre
    tracks = geometry.half_track_front, geometry.half_track_rear
    heights = geometry.roll_centre_height_front, geometry.roll_centre_height_rear
    unsprung = vehicle.mass.unsprung_front, vehicle.mass.unsprung_rear
    shares = geometry.static_front_share, 1 - geometry.static_front_share
    loads, roll = motion.loads[-1].reshape(2, 2), motion.roll[-1]
    apart = loads[:, 1] - loads[:, 0]
    tilts = apart / (2 * tyre.vertical_stiffness * np.array(tracks))
    weights = plant.sprung_mass * GRAVITY * np.array(shares)
    beside = weights.sum() * plant.cg_height_above_roll_axis * roll
    turned = 4.0 * wheel_inertia / tyre.radius * motion.lateral_acceleration[-1]
    beside += turned + (weights * heights + GRAVITY * np.array(unsprung) * tyre.radius) @ tilts
    return (
        float(apart @ tracks),
        float(vehicle.total_mass * motion.lateral_acceleration[-1] * vehicle.cg_height + beside),
        float((weights * (tyre.radius - np.array(heights))) @ (roll - tilts)),
    )
