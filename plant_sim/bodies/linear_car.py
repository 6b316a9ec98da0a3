"""The linear full car as a plant body: nine degrees of freedom, with or without hydraulic bars.

State: the 26 of :data:`vehicles.full_car.STATES`, then position and heading. The equations are
linear except for the limits of valve current, oil pressure and motor angle, and wheel loads that
end at zero. Constant speed, no friction limit.
"""

from math import cos, sin, tan

import numpy as np

from canroll.typing import Vector
from plant_sim.bodies import ports
from plant_sim.bodies.integrate import rk4
from plant_sim.bodies.ports import Body
from plant_sim.kernels.jit import cfunc, njit, stack_vector
from vehicles import GRAVITY, Vehicle
from vehicles.full_car import INPUTS, STATES, FullCar, from_vehicle, state_matrices
from vehicles.roll_stiffness import suspension_roll_stiffness

N_LINEAR = len(STATES)
N_DRIVE = len(INPUTS)
X, Y, YAW = N_LINEAR, N_LINEAR + 1, N_LINEAR + 2
N_STATES = N_LINEAR + 3

_drives, _rates = stack_vector(N_DRIVE), stack_vector(N_STATES)
HEAVE, PITCH, ROLL, HOP = 0, 1, 2, 3
RATES, HOP_RATE = 7, 10
SIDESLIP, YAW_RATE, OIL = 14, 15, 16

(
    P_SPEED,
    P_MASS,
    P_TYRE_STIFFNESS,
    P_RADIUS,
    P_CURRENT_LIMIT,
    P_PRESSURE_LIMIT,
    P_ANGLE_LIMIT,
    P_BAR_STIFFNESS,
    P_LEVER,
) = range(9)
P_ARM, P_OFFSET, P_TYRE_DAMPING = 9, 10, 11
(
    P_DISTANCE,
    P_BODY_DISTANCE,
    P_TRACK,
    P_CORNERING,
    P_STATIC,
    P_UNDER_AXIS,
    P_ROLL_CENTRE,
) = range(12, 26, 2)
P_MATRICES = 26


def parameters_of(car: FullCar, speed: float) -> Vector:
    """The parameter vector of ``car`` at ``speed`` (m/s); the matrices come last, row by row."""
    a, b = state_matrices(car, speed)
    p = np.zeros(P_MATRICES)
    p[P_SPEED], p[P_MASS] = speed, car.mass
    p[P_TYRE_STIFFNESS], p[P_TYRE_DAMPING] = car.tyre_stiffness, car.tyre_damping
    p[P_ARM], p[P_OFFSET] = car.roll_height, car.distance[0] - car.body_distance[0]
    p[P_RADIUS] = car.wheel_radius or 0.3
    if car.valves is not None:
        p[P_CURRENT_LIMIT] = car.valves.current_limit
        p[P_PRESSURE_LIMIT] = car.valves.supply_pressure
        p[P_ANGLE_LIMIT] = car.valves.angle_limit
        p[P_BAR_STIFFNESS] = car.valves.bar_stiffness
        p[P_LEVER] = car.valves.lever_ratio
    p[P_DISTANCE : P_DISTANCE + 2] = car.distance
    p[P_BODY_DISTANCE : P_BODY_DISTANCE + 2] = car.body_distance
    p[P_TRACK : P_TRACK + 2] = car.half_track
    p[P_CORNERING : P_CORNERING + 2] = car.cornering
    weight = car.mass * GRAVITY / (2 * (car.distance[0] - car.distance[1]))
    p[P_STATIC : P_STATIC + 2] = -weight * car.distance[1], weight * car.distance[0]
    p[P_ROLL_CENTRE : P_ROLL_CENTRE + 2] = car.roll_centre_height
    p[P_UNDER_AXIS : P_UNDER_AXIS + 2] = [
        car.roll_axis_height - held for held in car.roll_centre_height
    ]
    return np.concatenate([p, a.ravel(), b.ravel()])


def build(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
    """State at rest on a straight road at ``speed`` (m/s) and parameters, conventional bars."""
    car = from_vehicle(vehicle, suspension_stiffness=suspension_roll_stiffness(vehicle))
    return np.zeros(N_STATES), parameters_of(car, speed)


def build_hydraulic(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
    """The same with electro-hydraulic bars, driven by the valve currents."""
    stiffness = suspension_roll_stiffness(vehicle)
    car = from_vehicle(vehicle, suspension_stiffness=stiffness, hydraulic=True)
    return np.zeros(N_STATES), parameters_of(car, speed)


@njit
def derivative(state: Vector, inputs: Vector, p: Vector, rate: Vector) -> None:
    """Fill ``rate`` with the time derivative of ``state``."""
    drive = _drives()
    drive[0] = inputs[ports.STEER]
    limit = p[P_CURRENT_LIMIT]
    for i in range(4):
        drive[1 + i] = inputs[ports.ROAD_HEIGHT + i]
        drive[7 + i] = inputs[ports.CORNER_FORCE + i]
    for i in range(2):
        drive[5 + i] = min(max(inputs[ports.VALVE_CURRENT_FRONT + i], -limit), limit)
        drive[11 + i] = inputs[ports.BAR_MOMENT_FRONT + i]
    bank, grade = inputs[ports.BANK], inputs[ports.GRADE]
    drive[13] = sin(bank) * cos(grade)
    # less weight on a slope, and what the turn of a banked road's normal demands
    drive[14] = GRAVITY * (cos(bank) * cos(grade) - 1.0)
    drive[14] -= p[P_SPEED] * state[YAW_RATE] * tan(bank)
    b = P_MATRICES + N_LINEAR * N_LINEAR
    for i in range(N_LINEAR):
        total = 0.0
        for j in range(N_LINEAR):
            total += p[P_MATRICES + i * N_LINEAR + j] * state[j]
        for j in range(N_DRIVE):
            total += p[b + i * N_DRIVE + j] * drive[j]
        rate[i] = total
    heading, side = state[YAW], p[P_SPEED] * state[SIDESLIP]
    rate[X] = p[P_SPEED] * cos(heading) - side * sin(heading)
    rate[Y] = p[P_SPEED] * sin(heading) + side * cos(heading)
    rate[YAW] = state[YAW_RATE]


@njit
def _limit(state: Vector, p: Vector) -> None:
    """Oil pressure cannot exceed the supply, nor the motor its end stops."""
    for axle in range(2):
        i = OIL + 5 * axle
        pressure, angle = p[P_PRESSURE_LIMIT], p[P_ANGLE_LIMIT]
        state[i + 2] = min(max(state[i + 2], -pressure), pressure)
        if abs(state[i + 3]) > angle:
            state[i + 3] = angle if state[i + 3] > 0.0 else -angle
            if state[i + 3] * state[i + 4] > 0.0:
                state[i + 4] = 0.0


@njit
def _observe(state: Vector, inputs: Vector, p: Vector, outputs: Vector) -> None:
    rate = _rates()
    derivative(state, inputs, p, rate)
    speed, yaw_rate = p[P_SPEED], state[YAW_RATE]
    outputs[ports.X : ports.YAW + 1] = state[X : YAW + 1]
    outputs[ports.VX], outputs[ports.VY] = speed, speed * state[SIDESLIP]
    outputs[ports.YAW_RATE], outputs[ports.YAW_ACC] = yaw_rate, rate[YAW_RATE]
    outputs[ports.AX] = -outputs[ports.VY] * yaw_rate
    outputs[ports.HEAVE], outputs[ports.PITCH] = state[HEAVE], state[PITCH]
    outputs[ports.ROLL], outputs[ports.ROLL_RATE] = state[ROLL], state[RATES + 2]
    outputs[ports.ROLL_ACC] = rate[RATES + 2]
    outputs[ports.PITCH_RATE], outputs[ports.PITCH_ACC] = state[RATES + 1], rate[RATES + 1]
    outputs[ports.HEAVE_RATE], outputs[ports.HEAVE_ACC] = state[RATES], rate[RATES]
    pushed = 0.0
    for wheel in range(4):
        axle = wheel // 2
        sign = 1.0 if wheel % 2 == 0 else -1.0
        y, x = sign * p[P_TRACK + axle], p[P_BODY_DISTANCE + axle]
        hop = state[HOP + wheel]
        height = state[HEAVE] - x * state[PITCH] + y * state[ROLL]
        lift = state[RATES] - x * state[RATES + 1] + y * state[RATES + 2]
        gap = hop - inputs[ports.ROAD_HEIGHT + wheel]
        load = p[P_STATIC + axle] - p[P_TYRE_STIFFNESS] * gap
        load = max(load - p[P_TYRE_DAMPING] * state[HOP_RATE + wheel], 0.0)
        outputs[ports.TRAVEL + wheel] = height - hop
        outputs[ports.TRAVEL_RATE + wheel] = lift - state[HOP_RATE + wheel]
        outputs[ports.WHEEL_LOAD + wheel] = load
        outputs[ports.WHEEL_HEIGHT + wheel] = max(
            gap - p[P_STATIC + axle] / p[P_TYRE_STIFFNESS], 0.0
        )
        outputs[ports.WHEEL_SPEED + wheel] = (speed - y * yaw_rate) / p[P_RADIUS]
        tilt_rate = (state[HOP_RATE + 2 * axle] - state[HOP_RATE + 2 * axle + 1]) / (
            2.0 * p[P_TRACK + axle]
        )
        aside = p[P_DISTANCE + axle] * yaw_rate + p[P_UNDER_AXIS + axle] * state[RATES + 2]
        aside += p[P_ROLL_CENTRE + axle] * tilt_rate
        slip = -state[SIDESLIP] - aside / speed
        if axle == 0:
            slip += inputs[ports.STEER]
        force = 0.5 * p[P_CORNERING + axle] * slip
        outputs[ports.LATERAL_FORCE + wheel] = force
        pushed += force / p[P_MASS]
    outputs[ports.AY] = pushed - GRAVITY * sin(inputs[ports.BANK]) * cos(inputs[ports.GRADE])
    outputs[ports.BODY_ACC] = outputs[ports.AX]
    outputs[ports.BODY_ACC + 1] = speed * (rate[SIDESLIP] + yaw_rate)
    outputs[ports.BODY_ACC + 1] += p[P_OFFSET] * rate[YAW_RATE] - p[P_ARM] * rate[RATES + 2]
    outputs[ports.BODY_ACC + 2] = rate[RATES] - speed * yaw_rate * tan(inputs[ports.BANK])
    for axle in range(2):
        i = OIL + 5 * axle
        left = outputs[ports.TRAVEL + 2 * axle] - outputs[ports.TRAVEL + 2 * axle + 1]
        twist = p[P_LEVER] * left / (2.0 * p[P_TRACK + axle]) + state[i + 3]
        outputs[ports.BAR_MOMENT + axle] = -p[P_LEVER] * p[P_BAR_STIFFNESS] * twist
        outputs[ports.BAR_PRESSURE + axle] = state[i + 2]
        outputs[ports.BAR_ANGLE + axle] = state[i + 3]
    load = ports.WHEEL_LOAD
    left_off = outputs[load] == 0.0 and outputs[load + 2] == 0.0
    right_off = outputs[load + 1] == 0.0 and outputs[load + 3] == 0.0
    outputs[ports.TWO_WHEEL_LIFT] = 1.0 if left_off or right_off else 0.0
    if abs(state[ROLL]) > ports.ROLLOVER_ANGLE:
        outputs[ports.ROLLOVER] = 1.0


_advance = rk4(derivative)


@cfunc("void(f8[::1], f8[::1], f8[::1], f8[::1], f8)")
def step(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector, dt: float) -> None:
    """Advance ``state`` by ``dt`` (s) and fill ``outputs`` (:mod:`plant_sim.bodies.ports`)."""
    _advance(state, inputs, parameters, dt)
    _limit(state, parameters)
    _observe(state, inputs, parameters, outputs)


BODY = Body("linear_car", step, build, friction=False, constant_speed=True)
"""Linear full car."""
HYDRAULIC_BODY = Body(
    "linear_car_hydraulic", step, build_hydraulic, friction=False, constant_speed=True
)
"""Linear full car with electro-hydraulic bars."""
