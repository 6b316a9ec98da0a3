"""The 1-DOF roll plant: a linear bicycle gives a_y, one roll equation gives the body's roll.

I φ'' + C φ' + (K − m g h) φ = m h (a_y + g η) + M, with η the road bank (Redondo 2021, eq. 1;
Yim 2020, eq. 1). The speed is constant. Wheel loads follow from the moment balance per axle:
the forces of springs, dampers and actuators, plus roll-centre and unsprung terms.
"""

from math import cos, isnan, sin, tan

import numpy as np

from canroll.typing import Vector
from plant_sim.bodies import ports
from plant_sim.bodies.integrate import rk4
from plant_sim.bodies.ports import Body
from plant_sim.kernels.jit import cfunc, njit, stack_vector
from vehicles import GRAVITY, Vehicle

VY, YAW_RATE, X, Y, YAW, ROLL, ROLL_RATE = range(7)
N_STATES = 7

_rates = stack_vector(N_STATES)

(
    P_SPEED,
    P_MASS,
    P_YAW_INERTIA,
    P_FRONT,
    P_REAR,
    P_CORNERING_FRONT,
    P_CORNERING_REAR,
    P_ROLL_INERTIA,
    P_DAMPING,
    P_STIFFNESS,
    P_ROLL_ARM,
    P_TRACK_FRONT,
    P_TRACK_REAR,
    P_STIFFNESS_SHARE,
    P_DAMPING_SHARE,
    P_UNSPRUNG_FRONT,
    P_UNSPRUNG_REAR,
    P_RC_FRONT,
    P_RC_REAR,
    P_RADIUS,
    P_ARM,
    P_OFFSET,
) = range(22)
N_PARAMETERS = 22


def build(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
    """State at rest on a straight road at ``speed`` (m/s), and the parameter vector."""
    geometry, mass, plant, tyre = vehicle.geometry, vehicle.mass, vehicle.plant, vehicle.tyre
    parameters = np.zeros(N_PARAMETERS)
    parameters[P_SPEED] = speed
    parameters[P_MASS] = vehicle.total_mass
    parameters[P_YAW_INERTIA] = mass.yaw_inertia
    parameters[P_FRONT] = geometry.cg_to_front_axle
    parameters[P_REAR] = geometry.cg_to_rear_axle
    parameters[P_CORNERING_FRONT] = tyre.cornering_stiffness_front
    parameters[P_CORNERING_REAR] = tyre.cornering_stiffness_rear
    parameters[P_ROLL_INERTIA] = plant.roll_inertia
    parameters[P_DAMPING] = plant.roll_damping
    parameters[P_STIFFNESS] = plant.roll_stiffness
    parameters[P_ROLL_ARM] = plant.roll_arm
    parameters[P_TRACK_FRONT] = geometry.half_track_front
    parameters[P_TRACK_REAR] = geometry.half_track_rear
    parameters[P_STIFFNESS_SHARE] = vehicle.suspension.roll_stiffness_front_share
    parameters[P_DAMPING_SHARE] = vehicle.suspension.roll_damping_front_share
    parameters[P_UNSPRUNG_FRONT] = mass.unsprung_front
    parameters[P_UNSPRUNG_REAR] = mass.unsprung_rear
    parameters[P_RC_FRONT] = geometry.roll_centre_height_front
    parameters[P_RC_REAR] = geometry.roll_centre_height_rear
    parameters[P_RADIUS] = tyre.radius
    parameters[P_ARM] = plant.cg_height_above_roll_axis
    parameters[P_OFFSET] = vehicle.sprung_cg_offset
    return np.zeros(N_STATES), parameters


@njit
def axle_forces(state: Vector, inputs: Vector, parameters: Vector) -> tuple[float, float]:
    """Lateral forces of the front and the rear axle (N), linear in the slip angles."""
    prescribed = inputs[ports.LATERAL_ACCELERATION]
    if not isnan(prescribed):
        total = parameters[P_MASS] * (prescribed + GRAVITY * sin(inputs[ports.BANK]))
        wheelbase = parameters[P_FRONT] + parameters[P_REAR]
        return (
            total * parameters[P_REAR] / wheelbase,
            total * parameters[P_FRONT] / wheelbase,
        )
    speed = parameters[P_SPEED]
    slip_front = inputs[ports.STEER] - (state[VY] + parameters[P_FRONT] * state[YAW_RATE]) / speed
    slip_rear = -(state[VY] - parameters[P_REAR] * state[YAW_RATE]) / speed
    return (
        parameters[P_CORNERING_FRONT] * slip_front,
        parameters[P_CORNERING_REAR] * slip_rear,
    )


@njit
def actuator_moments(inputs: Vector, parameters: Vector) -> tuple[float, float]:
    """Moment of the actuators on the body at the front and the rear axle (N·m)."""
    corner = ports.CORNER_FORCE
    front = parameters[P_TRACK_FRONT] * (inputs[corner] - inputs[corner + 1])
    rear = parameters[P_TRACK_REAR] * (inputs[corner + 2] - inputs[corner + 3])
    return front + inputs[ports.BAR_MOMENT_FRONT], rear + inputs[ports.BAR_MOMENT_REAR]


@njit
def derivative(state: Vector, inputs: Vector, parameters: Vector, rate: Vector) -> None:
    """Fill ``rate`` with the time derivative of ``state``."""
    front, rear = axle_forces(state, inputs, parameters)
    bank = GRAVITY * sin(inputs[ports.BANK])
    lateral = (front + rear) / parameters[P_MASS] - bank
    yaw_rate = state[YAW_RATE]
    speed = parameters[P_SPEED]
    if not isnan(inputs[ports.LATERAL_ACCELERATION]):
        rate[VY] = 0.0
        rate[YAW_RATE] = 0.0
    else:
        rate[VY] = lateral - speed * yaw_rate
        rate[YAW_RATE] = (parameters[P_FRONT] * front - parameters[P_REAR] * rear) / parameters[
            P_YAW_INERTIA
        ]
    rate[X] = speed * cos(state[YAW]) - state[VY] * sin(state[YAW])
    rate[Y] = speed * sin(state[YAW]) + state[VY] * cos(state[YAW])
    rate[YAW] = yaw_rate
    moment_front, moment_rear = actuator_moments(inputs, parameters)
    rate[ROLL] = state[ROLL_RATE]
    rate[ROLL_RATE] = (
        parameters[P_ROLL_ARM] * (lateral + bank)
        + moment_front
        + moment_rear
        - parameters[P_DAMPING] * state[ROLL_RATE]
        - (parameters[P_STIFFNESS] - parameters[P_ROLL_ARM] * GRAVITY) * state[ROLL]
    ) / parameters[P_ROLL_INERTIA]


@njit
def observe(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector) -> None:
    """Fill ``outputs`` from state and inputs (:mod:`plant_sim.bodies.ports`)."""
    rate = _rates()
    derivative(state, inputs, parameters, rate)
    front, rear = axle_forces(state, inputs, parameters)
    bank = GRAVITY * sin(inputs[ports.BANK])
    pushed = (front + rear) / parameters[P_MASS]
    outputs[ports.X] = state[X]
    outputs[ports.Y] = state[Y]
    outputs[ports.YAW] = state[YAW]
    outputs[ports.VX] = parameters[P_SPEED]
    outputs[ports.VY] = state[VY]
    outputs[ports.AX] = -state[VY] * state[YAW_RATE]
    outputs[ports.AY] = pushed - bank
    outputs[ports.YAW_RATE] = state[YAW_RATE]
    outputs[ports.YAW_ACC] = rate[YAW_RATE]
    outputs[ports.ROLL] = state[ROLL]
    outputs[ports.ROLL_RATE] = state[ROLL_RATE]
    outputs[ports.ROLL_ACC] = rate[ROLL_RATE]
    normal = -parameters[P_SPEED] * state[YAW_RATE] * tan(inputs[ports.BANK])
    outputs[ports.BODY_ACC], outputs[ports.BODY_ACC + 2] = outputs[ports.AX], normal
    outputs[ports.BODY_ACC + 1] = outputs[ports.AY] - parameters[P_ARM] * rate[ROLL_RATE]
    outputs[ports.BODY_ACC + 1] += parameters[P_OFFSET] * rate[YAW_RATE]

    passed = parameters[P_STIFFNESS] * state[ROLL], parameters[P_DAMPING] * state[ROLL_RATE]
    moments = actuator_moments(inputs, parameters)
    wheelbase = parameters[P_FRONT] + parameters[P_REAR]
    lifted_left = True
    lifted_right = True
    for axle in range(2):
        if axle == 0:
            force, unsprung = front, parameters[P_UNSPRUNG_FRONT]
            roll_centre, track = parameters[P_RC_FRONT], parameters[P_TRACK_FRONT]
            stiffness_share = parameters[P_STIFFNESS_SHARE]
            damping_share = parameters[P_DAMPING_SHARE]
            static = parameters[P_REAR]
        else:
            force, unsprung = rear, parameters[P_UNSPRUNG_REAR]
            roll_centre, track = parameters[P_RC_REAR], parameters[P_TRACK_REAR]
            stiffness_share = 1.0 - parameters[P_STIFFNESS_SHARE]
            damping_share = 1.0 - parameters[P_DAMPING_SHARE]
            static = parameters[P_FRONT]
        weight = GRAVITY * cos(inputs[ports.BANK]) + normal
        weight *= parameters[P_MASS] * static / wheelbase
        moment = (
            stiffness_share * passed[0]
            + damping_share * passed[1]
            - moments[axle]
            + (force - unsprung * pushed) * roll_centre
            + unsprung * pushed * parameters[P_RADIUS]
        )
        transfer = min(max(moment / track, -weight), weight)
        left = ports.WHEEL_LOAD + 2 * axle
        outputs[left] = 0.5 * (weight - transfer)
        outputs[left + 1] = 0.5 * (weight + transfer)
        lifted_left = lifted_left and transfer >= weight
        lifted_right = lifted_right and transfer <= -weight
        for side in range(2):
            y = track if side == 0 else -track
            wheel = 2 * axle + side
            outputs[ports.TRAVEL + wheel] = y * state[ROLL]
            outputs[ports.TRAVEL_RATE + wheel] = y * state[ROLL_RATE]
            outputs[ports.WHEEL_SPEED + wheel] = (
                parameters[P_SPEED] - y * state[YAW_RATE]
            ) / parameters[P_RADIUS]
            outputs[ports.LATERAL_FORCE + wheel] = force * outputs[left + side] / weight
    outputs[ports.TWO_WHEEL_LIFT] = 1.0 if lifted_left or lifted_right else 0.0
    if abs(state[ROLL]) > ports.ROLLOVER_ANGLE:
        outputs[ports.ROLLOVER] = 1.0


advance = rk4(derivative)
"""``advance(state, inputs, parameters, dt)``: one step in place."""


@cfunc("void(f8[::1], f8[::1], f8[::1], f8[::1], f8)")
def step(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector, dt: float) -> None:
    """Advance ``state`` by ``dt`` (s) and fill ``outputs`` (:mod:`plant_sim.bodies.ports`)."""
    advance(state, inputs, parameters, dt)
    observe(state, inputs, parameters, outputs)


BODY = Body("roll1", step, build, friction=False, constant_speed=True)
"""1-DOF roll model with a linear bicycle."""
