"""The 14-DOF nonlinear car: planar motion, heave, roll, pitch, four suspension travels and spins.

Sprung body, two axles and four spinning wheels under the forces of suspension and tyres; no angle
is taken as small and every force has its reaction. The bodies' places and motion are in
:mod:`~canroll.plant_sim.bodies.kinematics`, their equations in
:mod:`~canroll.plant_sim.bodies.mass_matrix` and :mod:`~canroll.plant_sim.bodies.rigid_car`, the
wheels on the road in :mod:`~canroll.plant_sim.bodies.contact`.

- Suspension: a corner force acts along the travel, the axle's slide and turn relative to the body.
- Wheels can lift off; two wheels off the road for a while, or a large roll angle, end the run as a
  rollover.
"""

from math import cos, sin

import numpy as np

from canroll.plant_sim.bodies import curves, ports
from canroll.plant_sim.bodies.contact import (
    COUPLE,
    FORWARD,
    GAP,
    LATERAL,
    LEFT,
    LOAD,
    LONGITUDINAL,
    N_CONTACT,
    SHAFT,
    SLIP_RATE,
    SPIN_RATE,
    road_forces,
)
from canroll.plant_sim.bodies.held import N_HELD, TURN, UP, hold
from canroll.plant_sim.bodies.integrate import rk4
from canroll.plant_sim.bodies.kinematics import FORCES, MOTION, Forces, place
from canroll.plant_sim.bodies.mass_matrix import N_FACTORS, factor
from canroll.plant_sim.bodies.parameters import CAR, Car, build_parameters, car_of
from canroll.plant_sim.bodies.ports import ROLLOVER_ANGLE, Body
from canroll.plant_sim.bodies.rigid_car import ACCELERATIONS, accelerate
from canroll.plant_sim.kernels.jit import borrowed, cfunc, inlined, njit, record_of, stack_vector
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle

X, Y, YAW, VX, VY, HEAVE_RATE = range(6)  # of P; its velocity in the heading frame
ROLL_RATE, PITCH_RATE, YAW_RATE, HEAVE, ROLL, PITCH = range(6, 12)
TRAVEL, TRAVEL_RATE, SPIN, SLIP = 12, 16, 20, 24
LIFTED_TIME, ROLLED_OVER = 28, 29
N_STATES = 30

ROLLOVER_TIME = 1.0
"""Time (s) with both wheels of a side off the road after which the run ends as a rollover."""

# Slots of the algebraic results of one evaluation: those of the contact, then of each corner the
# force along the travel; accelerations of the whole car's CG and of the sprung one (heading frame).
R_LOAD, R_LONGITUDINAL, R_LATERAL, R_COUPLE = LOAD, LONGITUDINAL, LATERAL, COUPLE
R_SHAFT = SHAFT
R_CORNER, R_ACC, R_BODY_ACC, N_RESULTS = N_CONTACT, N_CONTACT + 4, N_CONTACT + 6, N_CONTACT + 9

_results, _rates, _slides = stack_vector(N_RESULTS), stack_vector(N_STATES), stack_vector(8)
_held, _factors = stack_vector(N_HELD), stack_vector(N_FACTORS)
_motion, _motion_of = stack_vector(MOTION.itemsize // 8), record_of(MOTION)
_forces, _forces_of = stack_vector(FORCES.itemsize // 8), record_of(FORCES)
_accelerations = stack_vector(ACCELERATIONS.itemsize // 8)
_accelerations_of = record_of(ACCELERATIONS)


def build(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
    """State on a flat straight road at ``speed`` (m/s), wheels rolling, and the parameters."""
    state, parameters = np.zeros(N_STATES), build_parameters(vehicle)
    car = parameters.view(CAR)[0]
    state[X], state[VX] = car["offset"], speed
    state[SPIN : SPIN + 4] = speed / car["radius"]
    return state, parameters


@inlined
def _suspension(state: Vector, held: Vector, car: Car, results: Vector, forces: Forces) -> None:
    """Fill the forces between body and wheels, along the travel; > 0 pushes them apart."""
    for k in range(2):
        axle, first = car.axle[k], 2 * k
        left, right = state[TRAVEL + first], state[TRAVEL + first + 1]
        bar = held[ports.BAR_MOMENT_FRONT + k] * axle.per_track - axle.bar * (left - right)
        for side in range(2):
            wheel = first + side
            travel = left if side == 0 else right
            force = curves.spring(axle, car.points, travel)
            force -= curves.damper(axle, car.points, travel, state[TRAVEL_RATE + wheel])
            force += curves.stop(axle, car.points, travel)
            force += bar if side == 0 else -bar
            results[R_CORNER + wheel] = force + held[ports.CORNER_FORCE + wheel]
        a, b = results[R_CORNER + first], results[R_CORNER + first + 1]
        forces.slide[k] = -(a + b)
        forces.tilt[k] = -axle.half_track * (a - b)


@inlined
def _wind(height: float, held: Vector, car: Car, forces: Forces) -> None:
    """Fill the wind's side force and its moments about P, ``height`` (m) above the road."""
    force = held[ports.WIND_FORCE]
    forces.wind_y = force
    forces.wind_roll = held[ports.WIND_ROLL] + height * force
    forces.wind_yaw = held[ports.WIND_YAW] - car.offset * force


@inlined
def _evaluate(state: Vector, held: Vector, car: Car, rate: Vector, results: Vector) -> None:
    motion, slides, factors = _motion_of(_motion()), _slides(), _factors()
    forces, accelerations = _forces_of(_forces()), _accelerations_of(_accelerations())
    for axle in range(2):
        left, right, per_track = TRAVEL + 2 * axle, TRAVEL + 2 * axle + 1, car.axle[axle].per_track
        for n in range(2):
            a, b = state[left + 4 * n], state[right + 4 * n]
            slides[4 * axle + 2 * n] = -0.5 * (a + b)
            slides[4 * axle + 2 * n + 1] = -(a - b) * per_track
    place(state[PITCH], state[ROLL], state[VX:HEAVE], slides, held, car, motion, forces)
    factor(motion, car, factors)
    _suspension(state, held, car, results, forces)
    road_forces(
        state[HEAVE],
        state[TRAVEL : TRAVEL + 4],
        state[SPIN : SPIN + 4],
        state[SLIP : SLIP + 4],
        held,
        car,
        motion,
        forces,
        results,
    )
    _wind(car.axis_height + state[HEAVE], held, car, forces)
    accelerate(motion, forces, factors, car, accelerations)

    # the heading frame turns, on a sloping road about its plane's axes as well
    yaw_rate, vx, vy, vz = state[YAW_RATE], state[VX], state[VY], state[HEAVE_RATE]
    turn_x, turn_y = yaw_rate * held[TURN], yaw_rate * held[TURN + 1]
    height = car.axis_height + state[HEAVE]
    c_yaw, s_yaw = cos(state[YAW]), sin(state[YAW])
    foot_x, foot_y = vx - turn_y * height, vy + turn_x * height
    rate[X] = foot_x * c_yaw - foot_y * s_yaw
    rate[Y] = foot_x * s_yaw + foot_y * c_yaw
    rate[YAW] = yaw_rate
    rate[VX] = accelerations.point_acc[0] + yaw_rate * vy - turn_y * vz
    rate[VY] = accelerations.point_acc[1] - yaw_rate * vx + turn_x * vz
    rate[HEAVE_RATE] = accelerations.point_acc[2] + turn_y * vx - turn_x * vy
    rate[ROLL_RATE], rate[PITCH_RATE] = accelerations.roll_q, accelerations.pitch_q
    rate[YAW_RATE] = accelerations.yaw_q
    rate[HEAVE], rate[ROLL], rate[PITCH] = vz, state[ROLL_RATE], state[PITCH_RATE]
    for wheel in range(4):
        axle = wheel // 2
        track = car.side[wheel]
        slide, tilt = accelerations.slide_q[axle], accelerations.tilt_q[axle]
        rate[TRAVEL + wheel] = state[TRAVEL_RATE + wheel]
        rate[TRAVEL_RATE + wheel] = -(slide + track * tilt)
        rate[SPIN + wheel] = results[SPIN_RATE + wheel]
        rate[SLIP + wheel] = results[SLIP_RATE + wheel]
    rate[LIFTED_TIME] = 0.0
    rate[ROLLED_OVER] = 0.0
    share = 1.0 / car.mass
    for n in range(2):
        k = FORWARD + 4 * n
        pushed = results[k] + results[k + 1] + results[k + 2] + results[k + 3]
        results[R_ACC + n] = share * pushed - GRAVITY * held[UP + n]
    results[R_ACC + 1] += share * held[ports.WIND_FORCE]
    for n in range(3):
        results[R_BODY_ACC + n] = accelerations.body_acc[n]


@njit
def evaluate(state: Vector, inputs: Vector, p: Vector, rate: Vector, results: Vector) -> None:
    """Fill ``rate`` with the time derivative of ``state``, and the algebraic ``results``."""
    held, own, car = _held(), _results(), car_of(p)
    hold(inputs, car, held)
    _evaluate(state, held, car, rate, own)
    for k in range(N_RESULTS):
        results[k] = own[k]


@njit
def derivative(state: Vector, inputs: Vector, parameters: Vector, rate: Vector) -> None:
    """Fill ``rate`` with the time derivative of ``state``."""
    evaluate(state, inputs, parameters, rate, _results())


@njit
def _held_derivative(state: Vector, held: Vector, parameters: Vector, rate: Vector) -> None:
    _evaluate(borrowed(state), borrowed(held), car_of(parameters), borrowed(rate), _results())


@njit
def _observe(state: Vector, inputs: Vector, p: Vector, outputs: Vector, dt: float) -> None:
    held, car = _held(), car_of(p)
    hold(inputs, car, held)
    _fill(state, held, car, outputs, dt)


@njit
def _fill(state: Vector, held: Vector, car: Car, outputs: Vector, dt: float) -> None:
    state, held, outputs = borrowed(state), borrowed(held), borrowed(outputs)
    rate, results = _rates(), _results()
    _evaluate(state, held, car, rate, results)
    c_yaw, s_yaw = cos(state[YAW]), sin(state[YAW])
    yaw_rate, offset, arm = state[YAW_RATE], car.offset, car.arm
    outputs[ports.X] = state[X] - offset * c_yaw
    outputs[ports.Y] = state[Y] - offset * s_yaw
    outputs[ports.YAW] = state[YAW]
    outputs[ports.VX] = rate[X] * c_yaw + rate[Y] * s_yaw
    outputs[ports.VY] = rate[Y] * c_yaw - rate[X] * s_yaw - offset * yaw_rate
    outputs[ports.AX], outputs[ports.AY] = results[R_ACC], results[R_ACC + 1]
    outputs[ports.BODY_ACC : ports.BODY_ACC + 3] = results[R_BODY_ACC : R_BODY_ACC + 3]
    outputs[ports.YAW_RATE], outputs[ports.YAW_ACC] = yaw_rate, rate[YAW_RATE]
    outputs[ports.ROLL], outputs[ports.PITCH] = state[ROLL], state[PITCH]
    outputs[ports.ROLL_RATE], outputs[ports.ROLL_ACC] = state[ROLL_RATE], rate[ROLL_RATE]
    outputs[ports.PITCH_RATE], outputs[ports.PITCH_ACC] = state[PITCH_RATE], rate[PITCH_RATE]
    c, s_pitch, c_roll, s_roll = (
        cos(state[PITCH]),
        sin(state[PITCH]),
        cos(state[ROLL]),
        sin(state[ROLL]),
    )
    pitch_rate, roll_rate = state[PITCH_RATE], state[ROLL_RATE]
    outputs[ports.HEAVE] = state[HEAVE] + arm * (c * c_roll - 1.0)
    outputs[ports.HEAVE_RATE] = state[HEAVE_RATE] - arm * (
        s_pitch * c_roll * pitch_rate + c * s_roll * roll_rate
    )
    outputs[ports.HEAVE_ACC] = rate[HEAVE_RATE] - arm * (
        s_pitch * c_roll * rate[PITCH_RATE]
        + c * s_roll * rate[ROLL_RATE]
        + c * c_roll * (pitch_rate * pitch_rate + roll_rate * roll_rate)
        - 2.0 * s_pitch * s_roll * pitch_rate * roll_rate
    )
    outputs[ports.TRAVEL : ports.TRAVEL + 4] = state[TRAVEL : TRAVEL + 4]
    outputs[ports.TRAVEL_RATE : ports.TRAVEL_RATE + 4] = state[TRAVEL_RATE : TRAVEL_RATE + 4]
    outputs[ports.WHEEL_SPEED : ports.WHEEL_SPEED + 4] = state[SPIN : SPIN + 4]
    outputs[ports.WHEEL_LOAD : ports.WHEEL_LOAD + 4] = results[R_LOAD : R_LOAD + 4]
    outputs[ports.LATERAL_FORCE : ports.LATERAL_FORCE + 4] = results[LEFT : LEFT + 4]
    outputs[ports.WHEEL_HEIGHT : ports.WHEEL_HEIGHT + 4] = results[GAP : GAP + 4]
    left_off = results[R_LOAD] == 0.0 and results[R_LOAD + 2] == 0.0
    right_off = results[R_LOAD + 1] == 0.0 and results[R_LOAD + 3] == 0.0
    outputs[ports.TWO_WHEEL_LIFT] = 1.0 if left_off or right_off else 0.0
    state[LIFTED_TIME] = state[LIFTED_TIME] + dt if left_off or right_off else 0.0
    if abs(state[ROLL]) > ROLLOVER_ANGLE or state[LIFTED_TIME] > ROLLOVER_TIME:
        state[ROLLED_OVER] = 1.0
    outputs[ports.ROLLOVER] = state[ROLLED_OVER]


_advance = rk4(_held_derivative)


@cfunc("void(f8[::1], f8[::1], f8[::1], f8[::1], f8)")
def step(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector, dt: float) -> None:
    """Advance ``state`` by ``dt`` (s) and fill ``outputs``; a car that rolled over stays so."""
    if state[ROLLED_OVER] == 0.0:
        held, car = _held(), car_of(parameters)
        hold(borrowed(inputs), car, held)
        _advance(borrowed(state), held, borrowed(parameters), dt)
        _fill(state, held, car, outputs, dt)


BODY = Body("nonlinear", step, build)
"""Nonlinear car of 14 degrees of freedom."""
