"""Parameters of the 14-DOF car, and the steady roll that they must give."""

import numpy as np
from scipy.optimize import brentq

from canroll.errors import CanrollError
from canroll.typing import Vector
from vehicles import GRAVITY, Vehicle

# Slots of the parameter vector; those from P_DISTANCE on name the first of two axles.
(
    P_MASS,
    P_SPRUNG,
    P_ARM,
    P_CG_HEIGHT,
    P_ROLL_INERTIA,
    P_PITCH_INERTIA,
    P_YAW_INERTIA,
    P_TYRE_STIFFNESS,
    P_TYRE_DAMPING,
    P_RADIUS,
    P_SPIN_INERTIA,
    P_ROLLING,
    P_FRICTION,
    P_FRICTION_SLOPE,
    P_CORNERING_SLOPE,
    P_SLIP_STIFFNESS,
    P_SHAPE,
    P_CURVATURE,
    P_RELAXATION,
    P_KNEE,
    P_HIGH_SPEED,
    P_BUMP_CLEARANCE,
    P_REBOUND_CLEARANCE,
    P_STOP_RATE,
) = range(24)
(
    P_DISTANCE,
    P_BODY_DISTANCE,
    P_TRACK,
    P_UNSPRUNG,
    P_STATIC,
    P_SPRUNG_LOAD,
    P_ROLL_CENTRE,
    P_SPRING,
    P_BAR,
    P_BUMP,
    P_REBOUND,
    P_CORNERING,
) = range(24, 48, 2)
N_PARAMETERS = 48


def axle_roll_shares(vehicle: Vehicle) -> tuple[float, float]:
    """Front and rear share of the suspension's roll stiffness."""
    share = vehicle.suspension.roll_stiffness_front_share
    return share, 1.0 - share


def steady_roll_gradient(vehicle: Vehicle, suspension_stiffness: float) -> float:
    """Steady body roll per lateral acceleration (rad per m/s²), suspension and tyres in series.

    ``suspension_stiffness`` (N·m/rad) is the roll stiffness of springs and bars of both axles.
    Solves the moment balance of the body about the roll axis and of each axle about the road.
    """
    geometry, plant, mass, tyre = vehicle.geometry, vehicle.plant, vehicle.mass, vehicle.tyre
    total, wheelbase = vehicle.total_mass, geometry.wheelbase
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    matrix[0, 0] = suspension_stiffness - plant.roll_arm * GRAVITY
    right[0] = plant.roll_arm
    axles = (
        (geometry.cg_to_rear_axle, geometry.half_track_front, mass.unsprung_front),
        (geometry.cg_to_front_axle, geometry.half_track_rear, mass.unsprung_rear),
    )
    heights = geometry.roll_centre_height_front, geometry.roll_centre_height_rear
    for i, (other, track, unsprung) in enumerate(axles):
        stiffness = axle_roll_shares(vehicle)[i] * suspension_stiffness
        force = total * other / wheelbase
        sprung = force - unsprung
        tilt = GRAVITY * (sprung * heights[i] + unsprung * tyre.radius)
        matrix[0, i + 1] = -stiffness
        matrix[i + 1, 0] = -stiffness
        matrix[i + 1, i + 1] = stiffness + 2 * tyre.vertical_stiffness * track**2 - tilt
        right[i + 1] = sprung * heights[i] + unsprung * tyre.radius
    return float(np.linalg.solve(matrix, right)[0])


def suspension_roll_stiffness(vehicle: Vehicle) -> float:
    """Roll stiffness (N·m/rad) of springs and bars with which the car rolls as its plant model.

    The plant's roll model has one stiffness, tyres included; here the tyres are separated.

    Raises:
        CanrollError: the tyres alone give more roll than the plant's roll model.
    """
    plant = vehicle.plant
    wanted = plant.roll_arm / plant.effective_stiffness

    def excess(stiffness: float) -> float:
        return steady_roll_gradient(vehicle, stiffness) - wanted

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


def build_parameters(vehicle: Vehicle) -> Vector:
    """Fill the parameter vector of the 14-DOF car."""
    geometry, plant, mass = vehicle.geometry, vehicle.plant, vehicle.mass
    suspension, tyre = vehicle.suspension, vehicle.tyre
    p = np.zeros(N_PARAMETERS)
    p[P_MASS] = vehicle.total_mass
    p[P_SPRUNG] = plant.sprung_mass
    p[P_ARM] = plant.cg_height_above_roll_axis
    p[P_CG_HEIGHT] = vehicle.sprung_cg_height
    p[P_ROLL_INERTIA] = plant.roll_inertia
    p[P_PITCH_INERTIA] = mass.pitch_inertia
    p[P_YAW_INERTIA] = mass.yaw_inertia
    p[P_TYRE_STIFFNESS] = tyre.vertical_stiffness
    p[P_TYRE_DAMPING] = tyre.vertical_damping
    p[P_RADIUS] = tyre.radius
    p[P_SPIN_INERTIA] = tyre.wheel_inertia
    p[P_ROLLING] = tyre.rolling_resistance
    p[P_FRICTION] = tyre.friction
    p[P_FRICTION_SLOPE] = tyre.friction_load_slope
    p[P_CORNERING_SLOPE] = tyre.cornering_load_slope
    p[P_SLIP_STIFFNESS] = tyre.longitudinal_stiffness
    p[P_SHAPE] = tyre.shape
    p[P_CURVATURE] = tyre.curvature
    p[P_RELAXATION] = tyre.relaxation_length
    p[P_KNEE] = suspension.knee_speed
    p[P_HIGH_SPEED] = suspension.high_speed_ratio
    p[P_BUMP_CLEARANCE] = suspension.bump_clearance
    p[P_REBOUND_CLEARANCE] = suspension.rebound_clearance
    p[P_STOP_RATE] = suspension.bump_stop_rate

    stiffness = suspension_roll_stiffness(vehicle)
    damping_share = suspension.roll_damping_front_share
    front, rear = geometry.cg_to_front_axle, geometry.cg_to_rear_axle
    p[P_DISTANCE : P_DISTANCE + 2] = front, -rear
    offset = vehicle.sprung_cg_offset
    p[P_BODY_DISTANCE : P_BODY_DISTANCE + 2] = front - offset, -rear - offset
    p[P_TRACK : P_TRACK + 2] = geometry.half_track_front, geometry.half_track_rear
    p[P_UNSPRUNG : P_UNSPRUNG + 2] = mass.unsprung_front / 2, mass.unsprung_rear / 2
    weight = vehicle.total_mass * GRAVITY / (2 * geometry.wheelbase)
    p[P_STATIC : P_STATIC + 2] = weight * rear, weight * front
    p[P_ROLL_CENTRE : P_ROLL_CENTRE + 2] = (
        geometry.roll_centre_height_front,
        geometry.roll_centre_height_rear,
    )
    p[P_SPRING : P_SPRING + 2] = suspension.spring_rate_front, suspension.spring_rate_rear
    p[P_CORNERING : P_CORNERING + 2] = (
        tyre.cornering_stiffness_front / 2,
        tyre.cornering_stiffness_rear / 2,
    )
    for axle, name in enumerate(("front", "rear")):
        track = p[P_TRACK + axle]
        p[P_SPRUNG_LOAD + axle] = 2 * (p[P_STATIC + axle] - p[P_UNSPRUNG + axle] * GRAVITY)
        bar = axle_roll_shares(vehicle)[axle] * stiffness - 2 * p[P_SPRING + axle] * track**2
        if bar < 0:
            raise CanrollError(
                f"{vehicle.name}: suspension.spring_rate_{name} {p[P_SPRING + axle]:g} N/m gives "
                f"more roll stiffness than the axle's share of plant.roll_stiffness; lower it by "
                f"{-bar / (2 * track**2):.0f} N/m"
            )
        p[P_BAR + axle] = bar
        share = damping_share if axle == 0 else 1.0 - damping_share
        mean = share * plant.roll_damping / (2 * track**2)
        p[P_BUMP + axle] = 2 * mean / (1 + suspension.rebound_bump_ratio)
        p[P_REBOUND + axle] = 2 * mean - p[P_BUMP + axle]
    return p
