"""The linear car behind the residuals: each number as a function of the unknowns.

A number is written once for a point of the box of uncertainties, so that the corners of the box say
what it may be wrong by.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import hypot

from canroll.gain_gen.monitors.uncertainty import NOMINAL, Factors, Uncertainty, vertices
from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.axles import axles
from canroll.vehicles.roll_stiffness import steady_roll, suspension_roll_stiffness

Gain = Callable[[Factors], float]
Pair = tuple[float, float]
"""Front and rear."""


@dataclass(frozen=True, slots=True)
class Car:
    """Parameters of the gains; pairs are (front, rear)."""

    vehicle: Vehicle
    stiffness: float
    shares: tuple[float, float]
    tracks: tuple[float, float]
    dampers: tuple[float, float]
    tyres: tuple[float, float]

    @property
    def arm(self) -> float:
        """m h, kg·m."""
        return self.vehicle.design.roll_arm

    @property
    def scale(self) -> tuple[float, float]:
        """Factors that make a moment on the axle's tyres one on the front's."""
        return 1.0, self.tyres[0] / self.tyres[1]


def car_of(vehicle: Vehicle) -> Car:
    """Return the car of a vehicle."""
    (front, rear), share = axles(vehicle), vehicle.suspension.roll_damping_front_share
    tyres = [2.0 * vehicle.tyre.vertical_stiffness * axle.half_track**2 for axle in (front, rear)]
    damping = vehicle.design.roll_damping
    return Car(
        vehicle,
        suspension_roll_stiffness(vehicle),
        (front.roll_share, rear.roll_share),
        (2.0 * front.half_track, 2.0 * rear.half_track),
        (share * damping, (1.0 - share) * damping),
        (tyres[0], tyres[1]),
    )


def effective_inertia(car: Car, f: Factors) -> float:
    """Return J = I_G − m h z: the roll inertia where a_y is that of the inertial unit.

    The unit, z above the CG, moves sideways with the body, so that its acceleration is not that of
    the roll axis and m h a_y holds a part of the body's inertia. It tilts with the body as well and
    measures the weight's component, so that neither gravity nor a bank enters.
    """
    roll, up = car.vehicle.design, car.vehicle.sensors.imu_position[2]
    return f.inertia * roll.inertia_about_cg - f.mass * f.height * roll.roll_arm * up


def tilted(car: Car, f: Factors) -> float:
    """Return 1 + g φ/a_y: what the unit on a leaning body measures per lateral acceleration."""
    roll = car.vehicle.design
    arm = f.mass * f.height * roll.roll_arm
    return 1.0 + GRAVITY * arm / (f.stiffness * roll.roll_stiffness - arm * GRAVITY)


def rolled(car: Car, axle: int, f: Factors) -> float:
    """Return the body's roll per roll of an axle's suspension: the rest is that of its tyres."""
    vehicle = car.vehicle
    stiffness = f.tyre * vehicle.tyre.vertical_stiffness
    vehicle = replace(vehicle, tyre=replace(vehicle.tyre, vertical_stiffness=stiffness))
    roll = steady_roll(vehicle, f.stiffness * car.stiffness)
    return roll[0] / (roll[0] - roll[1 + axle])


def steered(car: Car, f: Factors, speed: float, front: float, rear: float) -> float:
    """Return the steady lateral acceleration per road-wheel angle of a car with other tyres."""
    tyre = car.vehicle.tyre
    other = replace(
        tyre,
        cornering_stiffness_front=front * tyre.cornering_stiffness_front,
        cornering_stiffness_rear=rear * tyre.cornering_stiffness_rear,
    )
    return tilted(car, f) * replace(car.vehicle, tyre=other).lateral_gain(speed)


def blown(vehicle: Vehicle, wind: float, speed: float) -> float:
    """Return the roll moment (N·m) of a crosswind that the tyres bear and no a_y shows."""
    air = vehicle.side_wind
    lever = max(0.0, air.centre_of_pressure_height - vehicle.roll_axis_height)
    return air.force_factor * hypot(speed, wind) * wind * lever


def lifting(car: Car) -> tuple[float, float]:
    """Return the lateral accelerations (m/s²) at which the inner front and rear wheel lift."""
    vehicle = car.vehicle
    tilts = steady_roll(vehicle, car.stiffness)[1:]
    front, rear = (
        2.0 * axle.wheel_load * axle.half_track / (tyre * tilt)
        for axle, tyre, tilt in zip(axles(vehicle), car.tyres, tilts, strict=True)
    )
    return front, rear


def free_lean(car: Car) -> float:
    """Return the roll (rad) of the suspension at which the body first leans on its stops.

    Clearances are those of the car as it stands, with its load.
    """
    suspension = car.vehicle.suspension
    clearance = min(suspension.bump_clearance, suspension.rebound_clearance)
    return 2.0 * clearance / max(car.tracks)


def off_stops(car: Car, box: Uncertainty) -> float:
    """Return the lateral acceleration (m/s²) below which no car of the box leans on its stops."""
    roll = steady_roll(car.vehicle, car.stiffness)
    worst = (1.0 + box.mass) * (1.0 + box.height) / (1.0 - box.stiffness)
    return free_lean(car) / ((roll[0] - min(roll[1:])) * worst)


def deviation(gain: Gain, box: Uncertainty, names: tuple[str, ...]) -> float:
    """Return the largest deviation of a gain over the box, as share of its nominal value."""
    nominal = gain(NOMINAL)
    return max(abs(gain(corner) / nominal - 1.0) for corner in vertices(box, names))


def steering_deviation(car: Car, box: Uncertainty) -> float:
    """Return that of the lateral acceleration by steering, for tyres of each axle by themselves."""
    nominal = {speed: steered(car, NOMINAL, speed, 1.0, 1.0) for speed in (10.0, 20.0, 30.0)}
    low, high = 1.0 - box.cornering, 1.0 + box.cornering
    return max(
        abs(steered(car, corner, speed, front, rear) / nominal[speed] - 1.0)
        for speed in nominal
        for front, rear in ((low, high), (high, low))
        for corner in vertices(box, ("mass", "height", "stiffness"))
    )


def sprung_masses(vehicle: Vehicle) -> Pair:
    """Return the sprung masses of the front and the rear axle, kg."""
    per_length, both = vehicle.total_mass / vehicle.geometry.wheelbase, axles(vehicle)
    front, rear = (per_length * axle.opposite - axle.unsprung for axle in both)
    return front, rear


def axle_forces(vehicle: Vehicle, scale: Pair) -> Pair:
    """Return what lateral (kg·m) and yaw acceleration (kg·m²) make of the axles' difference."""
    both = axles(vehicle)
    front, rear = (
        sprung * axle.roll_centre + axle.unsprung * vehicle.tyre.radius
        for sprung, axle in zip(sprung_masses(vehicle), both, strict=True)
    )
    arm = (both[0].roll_centre + scale[1] * both[1].roll_centre) / vehicle.geometry.wheelbase
    return front - scale[1] * rear, arm * vehicle.mass.yaw_inertia
