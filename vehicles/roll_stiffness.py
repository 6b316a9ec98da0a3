"""The suspension's roll stiffness, the tyres' compliance left out, and how tables steer axles."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from canroll.errors import CanrollError
from canroll.vehicles.axles import Axle, axles
from canroll.vehicles.model import GRAVITY, Vehicle

BELOW = 1.0 - 1e-12
"""Share of what is permitted that rounding cannot make more than that."""


def axle_roll_shares(vehicle: Vehicle) -> tuple[float, float]:
    """Front and rear share of the suspension's roll stiffness."""
    share = vehicle.suspension.roll_stiffness_front_share
    return share, 1.0 - share


def steady_roll(
    vehicle: Vehicle, suspension_stiffness: float, carried: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, float, float]:
    """Steady roll of body, front and rear axle per lateral acceleration (rad per m/s²).

    Solves the moment balance of the body about the roll axis and of each axle about the road. The
    wheels of an axle, which turn with the car, bring about 2 I_w a_y / R of moment on it.

    Args:
        vehicle: its plant part.
        suspension_stiffness: roll stiffness of springs and bars of both axles, N·m/rad.
        carried: moment transmitted by actuators from the body to the front and the rear axle, per
            lateral acceleration, N·m per m/s².
    """
    return _steady_roll(vehicle, axles(vehicle), suspension_stiffness, carried)


def _steady_roll(
    vehicle: Vehicle,
    both: tuple[Axle, Axle],
    suspension_stiffness: float,
    carried: tuple[float, float] = (0.0, 0.0),
) -> tuple[float, float, float]:
    plant, tyre = vehicle.plant, vehicle.tyre
    total, wheelbase = vehicle.total_mass, vehicle.geometry.wheelbase
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    matrix[0, 0] = suspension_stiffness - plant.roll_arm * GRAVITY
    right[0] = plant.roll_arm - sum(carried)
    spinning = 2 * tyre.wheel_inertia / tyre.radius
    for i, axle in enumerate(both):
        stiffness = axle.roll_share * suspension_stiffness
        sprung = total * axle.opposite / wheelbase - axle.unsprung
        on_road = sprung * axle.roll_centre + axle.unsprung * tyre.radius
        tilt = GRAVITY * on_road
        matrix[0, i + 1] = -stiffness
        matrix[i + 1, 0] = -stiffness
        matrix[i + 1, i + 1] = stiffness + 2 * tyre.vertical_stiffness * axle.half_track**2 - tilt
        right[i + 1] = on_road + spinning + carried[i]
    body, front, rear = np.linalg.solve(matrix, right).tolist()
    return body, front, rear


@lru_cache(maxsize=256)
def suspension_roll_stiffness(vehicle: Vehicle) -> float:
    """Roll stiffness (N·m/rad) of springs and bars with which the car rolls like its plant model.

    The plant's roll model has one stiffness, tyres included; here the tyres are separated.

    Raises:
        CanrollError: the tyres alone cause more roll than the plant's roll model has.
    """
    plant = vehicle.plant
    wanted, both = plant.roll_arm / plant.effective_stiffness, axles(vehicle)

    def excess(stiffness: float) -> float:
        return _steady_roll(vehicle, both, stiffness)[0] - wanted

    hardest = 100 * plant.roll_stiffness
    if excess(hardest) >= 0:
        raise CanrollError(
            f"{vehicle.name}: tyre.vertical_stiffness {vehicle.tyre.vertical_stiffness:g} N/m "
            "makes the tyres alone softer in roll than plant.roll_stiffness: raise one or lower "
            "the other"
        )
    softest = 1.001 * plant.roll_stiffness
    if excess(softest) < 0:
        return softest
    return float(brentq(excess, softest, hardest, xtol=1e-6, rtol=1e-13))


@lru_cache(maxsize=256)
def axle_steer(vehicle: Vehicle) -> tuple[float, float]:
    """Steer of front and rear axle by their tables per lateral acceleration (rad per m/s²).

    Positive into the curve: by toe over compression, as the body rolls, and over the side force of
    each wheel, and at the front by the steering, which gives way to the force behind the kingpin
    (Gillespie, Fundamentals of Vehicle Dynamics, chapter 6: W_f (r ν + p) / K, with r ν the caster
    trail and p the pneumatic one). Slopes are those at rest; tyres share the axle's force alike.

    Raises:
        CanrollError: as for :func:`suspension_roll_stiffness`.
    """
    both = axles(vehicle)
    body, *tilts = _steady_roll(vehicle, both, suspension_roll_stiffness(vehicle))
    front, rear = (
        axle.curves.change("toe") * axle.half_track * (body - tilt)
        + axle.curves.change("toe_by_force") * 0.5 * axle.share * vehicle.total_mass
        for axle, tilt in zip(both, tilts, strict=True)
    )
    system = both[0].tables.steering_system
    if system is not None:
        trail = system.caster_trail + both[0].tyre.pneumatic_trail(both[0].wheel_load)
        front -= trail * both[0].share * vehicle.total_mass / system.torsional_stiffness
    return front, rear


def springs_within(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with springs no stiffer than its roll stiffness permits.

    A vehicle of a population may have less roll stiffness than the springs of the nominal one
    alone provide; such a vehicle has softer springs and no bar on that axle.

    Raises:
        CanrollError: as for :func:`suspension_roll_stiffness`.
    """
    stiffness = suspension_roll_stiffness(vehicle)
    rates = tuple(axle.spring for axle in axles(vehicle))
    front, rear = (
        min(axle.spring, BELOW * axle.roll_share * stiffness / (2 * axle.half_track**2))
        for axle in axles(vehicle)
    )
    if (front, rear) == rates:
        return vehicle
    softer = replace(vehicle.suspension, spring_rate_front=front, spring_rate_rear=rear)
    return replace(vehicle, suspension=softer)
