"""The linear full car as a plant body: nine degrees of freedom, with or without hydraulic bars.

State: the 26 of :data:`canroll.vehicles.full_car.STATES`, then position and heading. The equations
are linear except for the limits of valve current, oil pressure and motor angle, and wheel loads
that end at zero. Constant speed, no friction limit.
"""

from math import cos, sin, tan

import numpy as np

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.integrate import rk4
from canroll.plant_sim.bodies.ports import Body
from canroll.plant_sim.kernels.jit import cfunc, njit, record_of, stack_vector
from canroll.plant_sim.kernels.records import fields
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.full_car import INPUTS, STATES, FullCar, from_vehicle, state_matrices
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness

N_LINEAR = len(STATES)
N_DRIVE = len(INPUTS)
X, Y, YAW = N_LINEAR, N_LINEAR + 1, N_LINEAR + 2
N_STATES = N_LINEAR + 3

_drives, _rates = stack_vector(N_DRIVE), stack_vector(N_STATES)
HEAVE, PITCH, ROLL, HOP = 0, 1, 2, 3
RATES, HOP_RATE = 7, 10
SIDESLIP, YAW_RATE, OIL = 14, 15, 16

LINEAR_AXLE = fields(
    "f8", "distance body_distance half_track cornering wheel_load under_axis roll_centre"
)
LINEAR_CAR = np.dtype(
    [
        *fields("f8", "speed mass arm offset radius tyre_stiffness tyre_damping bar_stiffness"),
        *fields("f8", "lever current_limit pressure_limit angle_limit"),
        ("axle", LINEAR_AXLE, (2,)),
        *fields("f8", "a", N_LINEAR, N_LINEAR),
        *fields("f8", "b", N_LINEAR, N_DRIVE),
    ]
)
"""The parameters; ``under_axis`` is the depth of a roll centre under the roll axis."""

_car_of = record_of(LINEAR_CAR)


def parameters_of(car: FullCar, speed: float) -> Vector:
    """The parameter vector of ``car`` at ``speed`` (m/s), a :data:`LINEAR_CAR`."""
    parameters = np.zeros(1, LINEAR_CAR)
    record = parameters[0]
    record["a"], record["b"] = state_matrices(car, speed)
    record["speed"], record["mass"] = speed, car.mass
    record["tyre_stiffness"], record["tyre_damping"] = car.tyre_stiffness, car.tyre_damping
    record["arm"], record["offset"] = car.roll_height, car.distance[0] - car.body_distance[0]
    record["radius"] = car.wheel_radius or 0.3
    if car.valves is not None:
        record["current_limit"] = car.valves.current_limit
        record["pressure_limit"] = car.valves.supply_pressure
        record["angle_limit"] = car.valves.angle_limit
        record["bar_stiffness"] = car.valves.bar_stiffness
        record["lever"] = car.valves.lever_ratio
    weight = car.mass * GRAVITY / (2 * (car.distance[0] - car.distance[1]))
    for k, axle in enumerate(record["axle"]):
        for name in ("distance", "body_distance", "half_track", "cornering"):
            axle[name] = getattr(car, name)[k]
        axle["wheel_load"] = weight * abs(car.distance[1 - k])
        axle["roll_centre"] = car.roll_centre_height[k]
        axle["under_axis"] = car.roll_axis_height - car.roll_centre_height[k]
    return parameters.view(np.float64)


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
    drive, car = _drives(), _car_of(p)
    drive[0] = inputs[ports.STEER]
    limit = car.current_limit
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
    drive[14] -= car.speed * state[YAW_RATE] * tan(bank)
    for i in range(N_LINEAR):
        total = 0.0
        for j in range(N_LINEAR):
            total += car.a[i, j] * state[j]
        for j in range(N_DRIVE):
            total += car.b[i, j] * drive[j]
        rate[i] = total
    heading, side = state[YAW], car.speed * state[SIDESLIP]
    rate[X] = car.speed * cos(heading) - side * sin(heading)
    rate[Y] = car.speed * sin(heading) + side * cos(heading)
    rate[YAW] = state[YAW_RATE]


@njit
def _limit(state: Vector, p: Vector) -> None:
    """Oil pressure cannot exceed the supply, nor the motor its end stops."""
    car = _car_of(p)
    pressure, angle = car.pressure_limit, car.angle_limit
    for axle in range(2):
        i = OIL + 5 * axle
        state[i + 2] = min(max(state[i + 2], -pressure), pressure)
        if abs(state[i + 3]) > angle:
            state[i + 3] = angle if state[i + 3] > 0.0 else -angle
            if state[i + 3] * state[i + 4] > 0.0:
                state[i + 4] = 0.0


@njit
def _observe(state: Vector, inputs: Vector, p: Vector, outputs: Vector) -> None:
    rate, car = _rates(), _car_of(p)
    derivative(state, inputs, p, rate)
    speed, yaw_rate = car.speed, state[YAW_RATE]
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
        axle = car.axle[wheel // 2]
        sign = 1.0 if wheel % 2 == 0 else -1.0
        y, x = sign * axle.half_track, axle.body_distance
        hop = state[HOP + wheel]
        height = state[HEAVE] - x * state[PITCH] + y * state[ROLL]
        lift = state[RATES] - x * state[RATES + 1] + y * state[RATES + 2]
        gap = hop - inputs[ports.ROAD_HEIGHT + wheel]
        load = axle.wheel_load - car.tyre_stiffness * gap
        load = max(load - car.tyre_damping * state[HOP_RATE + wheel], 0.0)
        outputs[ports.TRAVEL + wheel] = height - hop
        outputs[ports.TRAVEL_RATE + wheel] = lift - state[HOP_RATE + wheel]
        outputs[ports.WHEEL_LOAD + wheel] = load
        outputs[ports.WHEEL_HEIGHT + wheel] = max(gap - axle.wheel_load / car.tyre_stiffness, 0.0)
        outputs[ports.WHEEL_SPEED + wheel] = (speed - y * yaw_rate) / car.radius
        hops = HOP_RATE + 2 * (wheel // 2)
        tilt_rate = (state[hops] - state[hops + 1]) / (2.0 * axle.half_track)
        aside = axle.distance * yaw_rate + axle.under_axis * state[RATES + 2]
        aside += axle.roll_centre * tilt_rate
        slip = -state[SIDESLIP] - aside / speed
        if wheel < 2:
            slip += inputs[ports.STEER]
        force = 0.5 * axle.cornering * slip
        outputs[ports.LATERAL_FORCE + wheel] = force
        pushed += force / car.mass
    outputs[ports.AY] = pushed - GRAVITY * sin(inputs[ports.BANK]) * cos(inputs[ports.GRADE])
    outputs[ports.BODY_ACC] = outputs[ports.AX]
    outputs[ports.BODY_ACC + 1] = speed * (rate[SIDESLIP] + yaw_rate)
    outputs[ports.BODY_ACC + 1] += car.offset * rate[YAW_RATE] - car.arm * rate[RATES + 2]
    outputs[ports.BODY_ACC + 2] = rate[RATES] - speed * yaw_rate * tan(inputs[ports.BANK])
    for k in range(2):
        i = OIL + 5 * k
        left = outputs[ports.TRAVEL + 2 * k] - outputs[ports.TRAVEL + 2 * k + 1]
        twist = car.lever * left / (2.0 * car.axle[k].half_track) + state[i + 3]
        outputs[ports.BAR_MOMENT + k] = -car.lever * car.bar_stiffness * twist
        outputs[ports.BAR_PRESSURE + k] = state[i + 2]
        outputs[ports.BAR_ANGLE + k] = state[i + 3]
    load = ports.WHEEL_LOAD
    left_off = outputs[load] == 0.0 and outputs[load + 2] == 0.0
    right_off = outputs[load + 1] == 0.0 and outputs[load + 3] == 0.0
    outputs[ports.TWO_WHEEL_LIFT] = 1.0 if left_off or right_off else 0.0
    if abs(state[ROLL]) > ports.ROLLOVER_ANGLE:
        outputs[ports.ROLLOVER] = 1.0


_advance = rk4(derivative)


@cfunc("void(f8[::1], f8[::1], f8[::1], f8[::1], f8)")
def step(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector, dt: float) -> None:
    """Advance ``state`` by ``dt`` (s), fill ``outputs`` (:mod:`canroll.plant_sim.bodies.ports`)."""
    _advance(state, inputs, parameters, dt)
    _limit(state, parameters)
    _observe(state, inputs, parameters, outputs)


BODY = Body("linear_car", step, build, friction=False, wind=False, constant_speed=True)
"""Linear full car."""
HYDRAULIC_BODY = Body(
    "linear_car_hydraulic",
    step,
    build_hydraulic,
    friction=False,
    wind=False,
    constant_speed=True,
)
"""Linear full car with electro-hydraulic bars."""
