"""The 14-DOF nonlinear car: planar motion, heave, roll, pitch, four wheel hops, four wheel spins.

[m, −m_s h; −m_s h, I_x + m_s h²] [a; φ''] =
    [ΣF_y − m g sin η; Σ y F + m_s g h (sin φ cos η + sin η)],  a = v_y' + v_x r,
with h the sprung CG above the roll axis and η the road bank. Each axle transmits the rest of its
lateral force at its roll centre. With ``kinematics.scrub`` in the vehicle's file, the contact
patches move sideways with body and axle according to that roll centre, and the forces turn the body
by the same arms. Tyres: :mod:`plant_sim.bodies.tyre`, with a relaxation length for the lateral
slip, which is taken at the contact patch. Wheels can lift off; two wheels off the ground for a
while, or a large roll angle, end the run as a rollover.
"""

from math import cos, sin

import numpy as np

from canroll.typing import Vector
from plant_sim.bodies import ports, tyre
from plant_sim.bodies.integrate import rk4
from plant_sim.bodies.parameters import (
    P_ARM,
    P_BAR,
    P_BODY_DISTANCE,
    P_BUMP,
    P_BUMP_CLEARANCE,
    P_CG_HEIGHT,
    P_CORNERING,
    P_CORNERING_SLOPE,
    P_CURVATURE,
    P_DISTANCE,
    P_FRICTION,
    P_FRICTION_SLOPE,
    P_HIGH_SPEED,
    P_KNEE,
    P_MASS,
    P_PITCH_INERTIA,
    P_RADIUS,
    P_REBOUND,
    P_REBOUND_CLEARANCE,
    P_RELAXATION,
    P_ROLL_CENTRE,
    P_ROLL_INERTIA,
    P_ROLLING,
    P_SCRUB_ROLL,
    P_SCRUB_TILT,
    P_SHAPE,
    P_SLIP_STIFFNESS,
    P_SPIN_INERTIA,
    P_SPRING,
    P_SPRUNG,
    P_SPRUNG_LOAD,
    P_STATIC,
    P_STOP_RATE,
    P_TRACK,
    P_TYRE_DAMPING,
    P_TYRE_STIFFNESS,
    P_UNSPRUNG,
    P_YAW_INERTIA,
    build_parameters,
)
from plant_sim.bodies.ports import Body
from plant_sim.kernels.jit import cfunc, njit, stack_vector
from vehicles import GRAVITY, Vehicle

X, Y, YAW, VX, VY, YAW_RATE = range(6)
HEAVE, ROLL, PITCH, HEAVE_RATE, ROLL_RATE, PITCH_RATE = range(6, 12)
HOP, HOP_RATE, SPIN, SLIP = 12, 16, 20, 24
LIFTED_TIME, ROLLED_OVER = 28, 29
N_STATES = 30

SLOWEST = 4.0
"""Speed (m/s) below which slips are no longer referred to the wheel's own speed."""

SLOWEST_ROLLING = 8.0
"""Speed (m/s) below which slip builds up no more slowly: a car that stops must not rock on."""

ROLLOVER_ANGLE = 0.6
"""Roll angle (rad) beyond which no car comes back."""

ROLLOVER_TIME = 1.0
"""Time (s) with both wheels of a side off the road after which the run ends as a rollover."""

# Slots of the algebraic results that one evaluation leaves for the outputs.
_LOAD, _LATERAL, _AY, _AX = 0, 4, 8, 9
_N_RESULTS = 10

_results, _rates = stack_vector(_N_RESULTS), stack_vector(N_STATES)


def build(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
    """State on a flat straight road at ``speed`` (m/s), wheels rolling, and the parameters."""
    state = np.zeros(N_STATES)
    state[VX] = speed
    state[SPIN : SPIN + 4] = speed / vehicle.tyre.radius
    return state, build_parameters(vehicle)


@njit
def damper(rate: float, bump: float, rebound: float, knee: float, ratio: float) -> float:
    """Force (N) of a bilinear damper against its stroke ``rate`` (m/s, extension > 0)."""
    slope = rebound if rate > 0.0 else bump
    fast = max(abs(rate) - knee, 0.0)
    size = slope * (min(abs(rate), knee) + ratio * fast)
    return size if rate > 0.0 else -size


@njit
def stop(travel: float, bump: float, rebound: float, rate: float) -> float:
    """Force (N) on the body, upwards, of quadratic stops beyond the clearances (m)."""
    if travel > rebound:
        return -rate * (travel - rebound) ** 2
    if travel < -bump:
        return rate * (travel + bump) ** 2
    return 0.0


@njit
def evaluate(state: Vector, inputs: Vector, p: Vector, rate: Vector, results: Vector) -> None:
    """Fill ``rate`` with the time derivative of ``state``, and the algebraic ``results``."""
    bank, grade = inputs[ports.BANK], inputs[ports.GRADE]
    steer = inputs[ports.STEER]
    vx, vy, yaw_rate = state[VX], state[VY], state[YAW_RATE]
    radius, sprung, arm = p[P_RADIUS], p[P_SPRUNG], p[P_ARM]

    c_front, s_front = cos(steer), sin(steer)
    c_bank, s_bank = cos(bank), sin(bank)
    c_yaw, s_yaw = cos(state[YAW]), sin(state[YAW])
    force_x, force_y, yaw_moment = 0.0, 0.0, 0.0
    for wheel in range(4):
        axle = wheel // 2
        y = p[P_TRACK + axle] if wheel % 2 == 0 else -p[P_TRACK + axle]
        static = p[P_STATIC + axle]
        gap = inputs[ports.ROAD_HEIGHT + wheel] - state[HOP + wheel]
        load = static + p[P_TYRE_STIFFNESS] * gap - p[P_TYRE_DAMPING] * state[HOP_RATE + wheel]
        load = load if static + p[P_TYRE_STIFFNESS] * gap > 0.0 and load > 0.0 else 0.0
        results[_LOAD + wheel] = load

        c, s = (c_front, s_front) if axle == 0 else (1.0, 0.0)
        tilt_rate = (state[HOP_RATE + 2 * axle] - state[HOP_RATE + 2 * axle + 1]) / (
            2.0 * p[P_TRACK + axle]
        )
        ahead = vx - y * yaw_rate
        aside = vy + p[P_DISTANCE + axle] * yaw_rate
        aside += p[P_SCRUB_ROLL + axle] * state[ROLL_RATE] + p[P_SCRUB_TILT + axle] * tilt_rate
        along, across = c * ahead + s * aside, c * aside - s * ahead
        reference = max(abs(along), SLOWEST)
        spin = state[SPIN + wheel]
        ratio = load / static
        linear_x = p[P_SLIP_STIFFNESS] * ratio * (spin * radius - along) / reference
        stiffness = p[P_CORNERING + axle] * ratio * tyre.falling(ratio, p[P_CORNERING_SLOPE])
        grip = p[P_FRICTION] * inputs[ports.FRICTION] * tyre.falling(ratio, p[P_FRICTION_SLOPE])
        tyre_x, tyre_y = tyre.forces(
            linear_x, stiffness * state[SLIP + wheel], grip * load, p[P_SHAPE], p[P_CURVATURE]
        )
        steady = -across / reference
        rolling = max(abs(along), SLOWEST_ROLLING)
        rate[SLIP + wheel] = rolling / p[P_RELAXATION] * (steady - state[SLIP + wheel])

        towards = spin / max(abs(spin), 1.0)
        brake = inputs[ports.BRAKE_FORCE + wheel] * towards
        drive = inputs[ports.DRIVE_FORCE] * static / (p[P_MASS] * GRAVITY)
        resistance = p[P_ROLLING] * load * towards
        rate[SPIN + wheel] = (drive - brake - resistance - tyre_x) * radius / p[P_SPIN_INERTIA]

        car_x, car_y = c * tyre_x - s * tyre_y, s * tyre_x + c * tyre_y
        results[_LATERAL + wheel] = car_y
        force_x += car_x
        force_y += car_y
        yaw_moment += p[P_DISTANCE + axle] * car_y - y * car_x

    pushed_y = force_y / p[P_MASS]
    pushed_x = force_x / p[P_MASS]
    lateral = force_y - p[P_MASS] * GRAVITY * s_bank
    results[_AY] = lateral / p[P_MASS]
    results[_AX] = pushed_x - GRAVITY * sin(grade)

    body_force, body_roll, body_pitch = 0.0, 0.0, 0.0
    for axle in range(2):
        track = p[P_TRACK + axle]
        left, right = 2 * axle, 2 * axle + 1
        x = p[P_BODY_DISTANCE + axle]
        height = state[HEAVE] - x * state[PITCH]
        speed = state[HEAVE_RATE] - x * state[PITCH_RATE]
        travel_left = height + track * state[ROLL] - state[HOP + left]
        travel_right = height - track * state[ROLL] - state[HOP + right]
        bar = (
            -p[P_BAR + axle] * (travel_left - travel_right) / (2.0 * track)
            + inputs[ports.BAR_MOMENT_FRONT + axle]
        ) / (2.0 * track)

        unsprung = p[P_UNSPRUNG + axle]
        axle_force = results[_LATERAL + left] + results[_LATERAL + right]
        tilt = (state[HOP + left] - state[HOP + right]) / (2.0 * track)
        geometric = (
            (axle_force - 2.0 * unsprung * pushed_y + p[P_SPRUNG_LOAD + axle] * tilt)
            * p[P_ROLL_CENTRE + axle]
            + 2.0 * unsprung * (pushed_y + GRAVITY * tilt) * radius
        ) / (2.0 * track)
        body_roll += p[P_SCRUB_ROLL + axle] * (axle_force - 2.0 * unsprung * pushed_y)
        shift = 2.0 * unsprung * pushed_x * radius / (p[P_DISTANCE] - p[P_DISTANCE + 1])
        shift = -0.5 * shift if axle == 0 else 0.5 * shift
        for side in range(2):
            wheel = 2 * axle + side
            sign = 1.0 if side == 0 else -1.0
            travel = travel_left if side == 0 else travel_right
            stroke = speed + sign * track * state[ROLL_RATE] - state[HOP_RATE + wheel]
            force = (
                -p[P_SPRING + axle] * travel
                - damper(
                    stroke,
                    p[P_BUMP + axle],
                    p[P_REBOUND + axle],
                    p[P_KNEE],
                    p[P_HIGH_SPEED],
                )
                + stop(travel, p[P_BUMP_CLEARANCE], p[P_REBOUND_CLEARANCE], p[P_STOP_RATE])
                + sign * bar
                + inputs[ports.CORNER_FORCE + wheel]
            )
            body_force += force
            body_roll += sign * track * force
            body_pitch -= x * force
            rate[HOP + wheel] = state[HOP_RATE + wheel]
            rate[HOP_RATE + wheel] = (
                results[_LOAD + wheel] - p[P_STATIC + axle] - force + sign * geometric - shift
            ) / unsprung

    body_roll += sprung * GRAVITY * arm * (sin(state[ROLL]) * c_bank + s_bank)
    coupling = sprung * arm
    determinant = p[P_MASS] * p[P_ROLL_INERTIA] - coupling * coupling
    acceleration = (p[P_ROLL_INERTIA] * lateral + coupling * body_roll) / determinant
    rate[ROLL_RATE] = (p[P_MASS] * body_roll + coupling * lateral) / determinant
    rate[PITCH_RATE] = (body_pitch - sprung * pushed_x * p[P_CG_HEIGHT]) / p[P_PITCH_INERTIA]
    rate[HEAVE_RATE] = body_force / sprung + GRAVITY * (1.0 - c_bank * cos(grade))
    rate[HEAVE], rate[ROLL], rate[PITCH] = state[HEAVE_RATE], state[ROLL_RATE], state[PITCH_RATE]
    rate[VX] = results[_AX] + yaw_rate * (vy - coupling / p[P_MASS] * state[ROLL_RATE])
    rate[VY] = acceleration - vx * yaw_rate
    rate[YAW_RATE] = yaw_moment / p[P_YAW_INERTIA]
    rate[X] = vx * c_yaw - vy * s_yaw
    rate[Y] = vx * s_yaw + vy * c_yaw
    rate[YAW] = yaw_rate
    rate[LIFTED_TIME] = 0.0
    rate[ROLLED_OVER] = 0.0


@njit
def derivative(state: Vector, inputs: Vector, parameters: Vector, rate: Vector) -> None:
    """Fill ``rate`` with the time derivative of ``state``."""
    evaluate(state, inputs, parameters, rate, _results())


@njit
def _observe(state: Vector, inputs: Vector, p: Vector, outputs: Vector, dt: float) -> None:
    rate, results = _rates(), _results()
    evaluate(state, inputs, p, rate, results)
    outputs[ports.X : ports.YAW + 1] = state[X : YAW + 1]
    outputs[ports.VX], outputs[ports.VY] = state[VX], state[VY]
    outputs[ports.AX], outputs[ports.AY] = results[_AX], results[_AY]
    outputs[ports.YAW_RATE], outputs[ports.YAW_ACC] = state[YAW_RATE], rate[YAW_RATE]
    outputs[ports.ROLL], outputs[ports.PITCH] = state[ROLL], state[PITCH]
    outputs[ports.HEAVE] = state[HEAVE]
    outputs[ports.ROLL_RATE], outputs[ports.ROLL_ACC] = state[ROLL_RATE], rate[ROLL_RATE]
    outputs[ports.PITCH_RATE], outputs[ports.PITCH_ACC] = state[PITCH_RATE], rate[PITCH_RATE]
    outputs[ports.HEAVE_RATE], outputs[ports.HEAVE_ACC] = state[HEAVE_RATE], rate[HEAVE_RATE]
    for wheel in range(4):
        axle = wheel // 2
        y = p[P_TRACK + axle] if wheel % 2 == 0 else -p[P_TRACK + axle]
        x = p[P_BODY_DISTANCE + axle]
        height = state[HEAVE] - x * state[PITCH] + y * state[ROLL]
        speed = state[HEAVE_RATE] - x * state[PITCH_RATE] + y * state[ROLL_RATE]
        outputs[ports.WHEEL_LOAD + wheel] = results[_LOAD + wheel]
        outputs[ports.LATERAL_FORCE + wheel] = results[_LATERAL + wheel]
        outputs[ports.TRAVEL + wheel] = height - state[HOP + wheel]
        outputs[ports.TRAVEL_RATE + wheel] = speed - state[HOP_RATE + wheel]
        outputs[ports.WHEEL_SPEED + wheel] = state[SPIN + wheel]
        outputs[ports.WHEEL_HEIGHT + wheel] = max(
            state[HOP + wheel]
            - inputs[ports.ROAD_HEIGHT + wheel]
            - p[P_STATIC + axle] / p[P_TYRE_STIFFNESS],
            0.0,
        )
    left_off = results[_LOAD] == 0.0 and results[_LOAD + 2] == 0.0
    right_off = results[_LOAD + 1] == 0.0 and results[_LOAD + 3] == 0.0
    outputs[ports.TWO_WHEEL_LIFT] = 1.0 if left_off or right_off else 0.0
    state[LIFTED_TIME] = state[LIFTED_TIME] + dt if left_off or right_off else 0.0
    if abs(state[ROLL]) > ROLLOVER_ANGLE or state[LIFTED_TIME] > ROLLOVER_TIME:
        state[ROLLED_OVER] = 1.0
    outputs[ports.ROLLOVER] = state[ROLLED_OVER]


_advance = rk4(derivative)


@cfunc("void(f8[::1], f8[::1], f8[::1], f8[::1], f8)")
def step(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector, dt: float) -> None:
    """Advance ``state`` by ``dt`` (s) and fill ``outputs``; a car that rolled over stays so."""
    if state[ROLLED_OVER] == 0.0:
        _advance(state, inputs, parameters, dt)
        _observe(state, inputs, parameters, outputs, dt)


BODY = Body("nonlinear", step, build)
"""Nonlinear car of 14 degrees of freedom."""
