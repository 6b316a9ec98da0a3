"""Parameters of the 14-DOF car."""

import numpy as np

from canroll.errors import CanrollError
from canroll.typing import Vector
from vehicles import GRAVITY, Vehicle
from vehicles.roll_stiffness import axle_roll_shares, suspension_roll_stiffness

# Slots of the parameter vector; those from P_DISTANCE on name the first of two axles.
(
    P_MASS,
    P_SPRUNG,
    P_OFFSET,
    P_ARM,
    P_AXIS_HEIGHT,
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
) = range(25)
(
    P_DISTANCE,
    P_TRACK,
    P_UNSPRUNG,
    P_STATIC,
    P_UNLOADED,
    P_PRELOAD,
    P_ROLL_CENTRE,
    P_SPRING,
    P_BAR,
    P_BUMP,
    P_REBOUND,
    P_CORNERING,
) = range(25, 49, 2)
N_PARAMETERS = 49


def build_parameters(vehicle: Vehicle) -> Vector:
    """Fill the parameter vector of the 14-DOF car.

    Inertias are the sprung body's about its own CG; ``P_OFFSET`` is its CG ahead of the whole
    car's; ``P_DISTANCE`` that of an axle ahead of the sprung CG. ``P_UNSPRUNG`` is an axle's mass,
    ``P_STATIC`` the load of a wheel, ``P_PRELOAD`` of its suspension, ``P_UNLOADED`` the radius of
    its tyre without load.
    """
    geometry, plant, mass = vehicle.geometry, vehicle.plant, vehicle.mass
    suspension, tyre = vehicle.suspension, vehicle.tyre
    p = np.zeros(N_PARAMETERS)
    p[P_MASS] = vehicle.total_mass
    p[P_SPRUNG] = plant.sprung_mass
    p[P_OFFSET] = vehicle.sprung_cg_offset
    p[P_ARM] = plant.cg_height_above_roll_axis
    p[P_AXIS_HEIGHT] = vehicle.roll_axis_height
    p[P_ROLL_INERTIA] = plant.inertia_about_cg
    p[P_PITCH_INERTIA] = mass.pitch_inertia
    p[P_YAW_INERTIA] = vehicle.sprung_yaw_inertia
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
    p[P_DISTANCE : P_DISTANCE + 2] = front - p[P_OFFSET], -rear - p[P_OFFSET]
    p[P_TRACK : P_TRACK + 2] = geometry.half_track_front, geometry.half_track_rear
    p[P_UNSPRUNG : P_UNSPRUNG + 2] = mass.unsprung_front, mass.unsprung_rear
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
        p[P_PRELOAD + axle] = p[P_STATIC + axle] - 0.5 * p[P_UNSPRUNG + axle] * GRAVITY
        p[P_UNLOADED + axle] = tyre.radius + p[P_STATIC + axle] / tyre.vertical_stiffness
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
