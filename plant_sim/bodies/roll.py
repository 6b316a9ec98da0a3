"""The 1-DOF roll plant: a linear bicycle gives a_y, one roll equation gives the body's roll.

I φ'' + C φ' + (K − m g h) φ = m h (a_y + g η) + M, with η the road bank (Redondo 2021, eq. 1;
Yim 2020, eq. 1). The speed is constant. Wheel loads follow from the moment balance per axle:
the forces of springs, dampers and actuators, plus roll-centre and unsprung terms.
"""

from math import cos, isnan, sin, tan

import numpy as np

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.integrate import rk4
from canroll.plant_sim.bodies.ports import Body
from canroll.plant_sim.kernels.jit import cfunc, njit, record_of, stack_vector
from canroll.plant_sim.kernels.records import fields
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.axles import axles

VY, YAW_RATE, X, Y, YAW, ROLL, ROLL_RATE = range(7)
N_STATES = 7

_rates = stack_vector(N_STATES)

ROLL_AXLE = fields(
    "f8", "ahead cornering share half_track roll_share damping_share unsprung roll_centre"
)
ROLL_CAR = np.dtype(
    [
        *fields("f8", "speed mass yaw_inertia roll_inertia damping stiffness roll_arm radius arm"),
        *fields("f8", "offset"),
        ("axle", ROLL_AXLE, (2,)),
    ]
)
"""The parameters; of an axle ``share`` is that of the weight, ``roll_share`` of the stiffness."""

_car_of = record_of(ROLL_CAR)


def build(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
    """State at rest on a straight road at ``speed`` (m/s), and the parameter vector."""
    plant, record = vehicle.plant, np.zeros(1, ROLL_CAR)
    car = record[0]
    car["speed"] = speed
    car["mass"] = vehicle.total_mass
    car["yaw_inertia"] = vehicle.mass.yaw_inertia
    car["roll_inertia"] = plant.roll_inertia
    car["damping"] = plant.roll_damping
    car["stiffness"] = plant.roll_stiffness
    car["roll_arm"] = plant.roll_arm
    car["radius"] = vehicle.tyre.radius
    car["arm"] = plant.cg_height_above_roll_axis
    car["offset"] = vehicle.sprung_cg_offset
    for data, axle in zip(car["axle"], axles(vehicle), strict=True):
        for name in ("ahead", "cornering", "half_track", "roll_share", "unsprung", "roll_centre"):
            data[name] = getattr(axle, name)
        data["share"] = axle.opposite / vehicle.geometry.wheelbase
        data["damping_share"] = axle.roll_damping / plant.roll_damping
    return np.zeros(N_STATES), record.view(np.float64)


@njit
def axle_forces(state: Vector, inputs: Vector, parameters: Vector) -> tuple[float, float]:
    """Lateral forces of the front and the rear axle (N), linear in the slip angles."""
    car = _car_of(parameters)
    front, rear = car.axle[0], car.axle[1]
    prescribed = inputs[ports.LATERAL_ACCELERATION]
    if not isnan(prescribed):
        total = car.mass * (prescribed + GRAVITY * sin(inputs[ports.BANK]))
        return total * front.share, total * rear.share
    yaw_rate, vy, speed = state[YAW_RATE], state[VY], car.speed
    return (
        front.cornering * (inputs[ports.STEER] - (vy + front.ahead * yaw_rate) / speed),
        rear.cornering * -(vy + rear.ahead * yaw_rate) / speed,
    )


@njit
def actuator_moment(inputs: Vector, parameters: Vector, axle: int) -> float:
    """Moment of an axle's actuators on the body (N·m)."""
    corner, half_track = ports.CORNER_FORCE + 2 * axle, _car_of(parameters).axle[axle].half_track
    moment: float = half_track * (inputs[corner] - inputs[corner + 1])
    moment += inputs[ports.BAR_MOMENT_FRONT + axle]
    return moment


@njit
def derivative(state: Vector, inputs: Vector, parameters: Vector, rate: Vector) -> None:
    """Fill ``rate`` with the time derivative of ``state``."""
    car = _car_of(parameters)
    front, rear = axle_forces(state, inputs, parameters)
    bank = GRAVITY * sin(inputs[ports.BANK])
    lateral = (front + rear) / car.mass - bank
    yaw_rate, speed = state[YAW_RATE], car.speed
    if not isnan(inputs[ports.LATERAL_ACCELERATION]):
        rate[VY] = 0.0
        rate[YAW_RATE] = 0.0
    else:
        rate[VY] = lateral - speed * yaw_rate
        turning = car.axle[0].ahead * front + car.axle[1].ahead * rear
        rate[YAW_RATE] = turning / car.yaw_inertia
    rate[X] = speed * cos(state[YAW]) - state[VY] * sin(state[YAW])
    rate[Y] = speed * sin(state[YAW]) + state[VY] * cos(state[YAW])
    rate[YAW] = yaw_rate
    rate[ROLL] = state[ROLL_RATE]
    rate[ROLL_RATE] = (
        car.roll_arm * (lateral + bank)
        + actuator_moment(inputs, parameters, 0)
        + actuator_moment(inputs, parameters, 1)
        - car.damping * state[ROLL_RATE]
        - (car.stiffness - car.roll_arm * GRAVITY) * state[ROLL]
    ) / car.roll_inertia


@njit
def observe(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector) -> None:
    """Fill ``outputs`` from state and inputs (:mod:`canroll.plant_sim.bodies.ports`)."""
    rate, car = _rates(), _car_of(parameters)
    derivative(state, inputs, parameters, rate)
    forces = axle_forces(state, inputs, parameters)
    pushed = (forces[0] + forces[1]) / car.mass
    outputs[ports.X] = state[X]
    outputs[ports.Y] = state[Y]
    outputs[ports.YAW] = state[YAW]
    outputs[ports.VX] = car.speed
    outputs[ports.VY] = state[VY]
    outputs[ports.AX] = -state[VY] * state[YAW_RATE]
    outputs[ports.AY] = pushed - GRAVITY * sin(inputs[ports.BANK])
    outputs[ports.YAW_RATE] = state[YAW_RATE]
    outputs[ports.YAW_ACC] = rate[YAW_RATE]
    outputs[ports.ROLL] = state[ROLL]
    outputs[ports.ROLL_RATE] = state[ROLL_RATE]
    outputs[ports.ROLL_ACC] = rate[ROLL_RATE]
    normal = -car.speed * state[YAW_RATE] * tan(inputs[ports.BANK])
    outputs[ports.BODY_ACC], outputs[ports.BODY_ACC + 2] = outputs[ports.AX], normal
    outputs[ports.BODY_ACC + 1] = outputs[ports.AY] - car.arm * rate[ROLL_RATE]
    outputs[ports.BODY_ACC + 1] += car.offset * rate[YAW_RATE]

    lifted_left = True
    lifted_right = True
    for k in range(2):
        axle, force = car.axle[k], forces[0] if k == 0 else forces[1]
        weight = GRAVITY * cos(inputs[ports.BANK]) + normal
        weight *= car.mass * axle.share
        moment = (
            axle.roll_share * (car.stiffness * state[ROLL])
            + axle.damping_share * (car.damping * state[ROLL_RATE])
            - actuator_moment(inputs, parameters, k)
            + (force - axle.unsprung * pushed) * axle.roll_centre
            + axle.unsprung * pushed * car.radius
        )
        transfer = min(max(moment / axle.half_track, -weight), weight)
        left = ports.WHEEL_LOAD + 2 * k
        outputs[left] = 0.5 * (weight - transfer)
        outputs[left + 1] = 0.5 * (weight + transfer)
        lifted_left = lifted_left and transfer >= weight
        lifted_right = lifted_right and transfer <= -weight
        for side in range(2):
            y = axle.half_track if side == 0 else -axle.half_track
            wheel = 2 * k + side
            outputs[ports.TRAVEL + wheel] = y * state[ROLL]
            outputs[ports.TRAVEL_RATE + wheel] = y * state[ROLL_RATE]
            outputs[ports.WHEEL_SPEED + wheel] = (car.speed - y * state[YAW_RATE]) / car.radius
            outputs[ports.LATERAL_FORCE + wheel] = force * outputs[left + side] / weight
    outputs[ports.TWO_WHEEL_LIFT] = 1.0 if lifted_left or lifted_right else 0.0
    if abs(state[ROLL]) > ports.ROLLOVER_ANGLE:
        outputs[ports.ROLLOVER] = 1.0


advance = rk4(derivative)
"""``advance(state, inputs, parameters, dt)``: one step in place."""


@cfunc("void(f8[::1], f8[::1], f8[::1], f8[::1], f8)")
def step(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector, dt: float) -> None:
    """Advance ``state`` by ``dt`` (s), fill ``outputs`` (:mod:`canroll.plant_sim.bodies.ports`)."""
    advance(state, inputs, parameters, dt)
    observe(state, inputs, parameters, outputs)


BODY = Body("roll1", step, build, friction=False, wind=False, constant_speed=True)
"""1-DOF roll model with a linear bicycle."""
