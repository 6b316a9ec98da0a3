"""The 14-DOF nonlinear car: planar motion, heave, roll, pitch, four suspension travels and spins.

Sprung body, two axles and four spinning wheels under the forces of suspension and tyres; no angle
is taken as small and every force has its reaction. :mod:`plant_sim.bodies.rigid_car` has the bodies
and their equations of motion, :mod:`plant_sim.bodies.tyre` the tyres' forces.

- Suspension: a corner force acts along the travel, the axle's slide and turn relative to the body.
- A wheel touches the road at its lowest line. The lateral slip is taken there, with a relaxation
  length; so are the forces on the axle. Spin and slip refer to one effective rolling radius.
- A spinning wheel is a gyrostat on its axle, with drive and brake torque between the two.
- Wheels can lift off; two wheels off the road for a while, or a large roll angle, end the run as a
  rollover.
"""

from math import cos, sin, sqrt

import numpy as np

from canroll.typing import Vector
from plant_sim.bodies import ports, rigid_car, tyre
from plant_sim.bodies.integrate import rk4
from plant_sim.bodies.parameters import (
    P_ARM,
    P_AXIS_HEIGHT,
    P_BAR,
    P_BUMP,
    P_BUMP_CLEARANCE,
    P_CORNERING,
    P_CORNERING_SLOPE,
    P_CURVATURE,
    P_DISTANCE,
    P_FRICTION,
    P_FRICTION_SLOPE,
    P_HIGH_SPEED,
    P_KNEE,
    P_MASS,
    P_OFFSET,
    P_PRELOAD,
    P_RADIUS,
    P_REBOUND,
    P_REBOUND_CLEARANCE,
    P_RELAXATION,
    P_ROLLING,
    P_SHAPE,
    P_SLIP_STIFFNESS,
    P_SPIN_INERTIA,
    P_SPRING,
    P_STATIC,
    P_STOP_RATE,
    P_TRACK,
    P_TYRE_DAMPING,
    P_TYRE_STIFFNESS,
    P_UNLOADED,
    build_parameters,
)
from plant_sim.bodies.ports import ROLLOVER_ANGLE, Body
from plant_sim.bodies.rigid_car import (
    AXLE,
    BODY_ACC,
    COS,
    COS_PITCH,
    FORCE,
    HUB_VELOCITY,
    HUB_Y,
    HUB_Z,
    MOMENT,
    N_ACCELERATIONS,
    N_AXLE,
    N_FORCES,
    N_MOTION,
    PITCH_Q,
    POINT_ACC,
    RATE,
    ROLL_Q,
    SIN,
    SIN_PITCH,
    SLIDE,
    SLIDE_Q,
    TILT,
    TILT_Q,
    TILT_RATE,
    UP,
    YAW_Q,
    Q,
)
from plant_sim.kernels.jit import cfunc, inlined, njit, stack_vector
from vehicles import GRAVITY, Vehicle

X, Y, YAW, VX, VY, HEAVE_RATE = range(6)  # of P; its velocity in the heading frame
ROLL_RATE, PITCH_RATE, YAW_RATE, HEAVE, ROLL, PITCH = range(6, 12)
TRAVEL, TRAVEL_RATE, SPIN, SLIP = 12, 16, 20, 24
LIFTED_TIME, ROLLED_OVER = 28, 29
N_STATES = 30

SLOWEST = 4.0
"""Speed (m/s) below which slips are no longer referred to the wheel's own speed."""

SLOWEST_ROLLING = 8.0
"""Speed (m/s) below which slip builds up no more slowly: a car that stops must not rock on."""

ROLLOVER_TIME = 1.0
"""Time (s) with both wheels of a side off the road after which the run ends as a rollover."""

# Slots of the algebraic results of one evaluation. Of each wheel: normal force, tyre force along
# its own longitudinal and lateral axis in the road plane, couple of the road about the wheel axis,
# force along the car's left, gap to the road, force along the travel, torque of the shaft.
# Accelerations of the whole car's CG and of the sprung one, in the heading frame.
R_LOAD, R_LONGITUDINAL, R_LATERAL, R_COUPLE, R_SIDE, R_GAP, R_CORNER, R_SHAFT = range(0, 32, 4)
R_ACC, R_BODY_ACC, N_RESULTS = 32, 34, 37

_results, _rates, _slides = stack_vector(N_RESULTS), stack_vector(N_STATES), stack_vector(8)
_motion, _forces = stack_vector(N_MOTION), stack_vector(2 * N_FORCES)
_found = stack_vector(N_ACCELERATIONS)


def build(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
    """State on a flat straight road at ``speed`` (m/s), wheels rolling, and the parameters."""
    state, parameters = np.zeros(N_STATES), build_parameters(vehicle)
    state[X], state[VX] = parameters[P_OFFSET], speed
    state[SPIN : SPIN + 4] = speed / vehicle.tyre.radius
    return state, parameters


@inlined
def damper(rate: float, bump: float, rebound: float, knee: float, ratio: float) -> float:
    """Force (N) of a bilinear damper against its stroke ``rate`` (m/s, extension > 0)."""
    slope = rebound if rate > 0.0 else bump
    fast = max(abs(rate) - knee, 0.0)
    size = slope * (min(abs(rate), knee) + ratio * fast)
    return size if rate > 0.0 else -size


@inlined
def stop(travel: float, bump: float, rebound: float, rate: float) -> float:
    """Force (N) on the body, upwards, of quadratic stops beyond the clearances (m)."""
    if travel > rebound:
        return -rate * (travel - rebound) ** 2
    if travel < -bump:
        return rate * (travel + bump) ** 2
    return 0.0


@inlined
def _suspension(state: Vector, inputs: Vector, p: Vector, results: Vector, forces: Vector) -> None:
    """Fill the forces between body and wheels, along the travel; > 0 pushes them apart."""
    knee, ratio = p[P_KNEE], p[P_HIGH_SPEED]
    bump_clearance, rebound_clearance = p[P_BUMP_CLEARANCE], p[P_REBOUND_CLEARANCE]
    for axle in range(2):
        first, track, spring = 2 * axle, p[P_TRACK + axle], p[P_SPRING + axle]
        left, right = state[TRAVEL + first], state[TRAVEL + first + 1]
        bar = inputs[ports.BAR_MOMENT_FRONT + axle] - p[P_BAR + axle] * (left - right) / (
            2.0 * track
        )
        bar = bar / (2.0 * track)
        for side in range(2):
            wheel = first + side
            travel = left if side == 0 else right
            force = p[P_PRELOAD + axle] - spring * travel
            force -= damper(
                state[TRAVEL_RATE + wheel], p[P_BUMP + axle], p[P_REBOUND + axle], knee, ratio
            )
            force += stop(travel, bump_clearance, rebound_clearance, p[P_STOP_RATE])
            force += bar if side == 0 else -bar
            results[R_CORNER + wheel] = force + inputs[ports.CORNER_FORCE + wheel]
        a, b = results[R_CORNER + first], results[R_CORNER + first + 1]
        forces[N_FORCES * axle + SLIDE] = -(a + b)
        forces[N_FORCES * axle + TILT] = -track * (a - b)


@inlined
def normal_force(stiffness: float, damping: float, deflection: float, lift: float) -> float:
    """Radial force (N) of a tyre deflected by that (m) while its radius grows by ``lift`` (m/s)."""
    if deflection <= 0.0:
        return 0.0
    return max(stiffness * deflection - damping * lift, 0.0)


@inlined
def tyre_forces(  # noqa: PLR0917
    p: Vector,
    axle: int,
    friction: float,
    load: float,
    along: float,
    turned: float,
    slip: float,
) -> tuple[float, float]:
    """Longitudinal and lateral force (N).

    ``along`` is the speed of the contact along the wheel, ``turned`` that of the tread by the spin
    (m/s), ``slip`` the lateral one as it has built up.
    """
    ratio = load / p[P_STATIC + axle]
    reference = max(abs(along), SLOWEST)
    linear_x = p[P_SLIP_STIFFNESS] * ratio * (turned - along) / reference
    stiffness = p[P_CORNERING + axle] * ratio * tyre.falling(ratio, p[P_CORNERING_SLOPE])
    grip = p[P_FRICTION] * friction * tyre.falling(ratio, p[P_FRICTION_SLOPE])
    return tyre.forces(linear_x, stiffness * slip, grip * load, p[P_SHAPE], p[P_CURVATURE])


@inlined
def _road_forces(  # noqa: PLR0917
    state: Vector,
    inputs: Vector,
    p: Vector,
    motion: Vector,
    rate: Vector,
    results: Vector,
    forces: Vector,
) -> None:
    """Fill the road's forces on both axles and the rates of spins and slips."""
    c, s = motion[COS_PITCH], motion[SIN_PITCH]
    steered_c, steered_s = cos(inputs[ports.STEER]), sin(inputs[ports.STEER])
    ox, oy, oz = motion[RATE], motion[RATE + 1], motion[RATE + 2]
    height, radius = p[P_AXIS_HEIGHT] + state[HEAVE], p[P_RADIUS]
    per_inertia, per_relaxation = 1.0 / p[P_SPIN_INERTIA], 1.0 / p[P_RELAXATION]
    # traction is shared by static load
    drive_per_load = inputs[ports.DRIVE_FORCE] / (p[P_MASS] * GRAVITY)
    friction = inputs[ports.FRICTION]
    total_x, total_y = 0.0, 0.0
    for axle in range(2):
        k, f, track = AXLE + N_AXLE * axle, N_FORCES * axle, p[P_TRACK + axle]
        c_tilt, s_tilt = motion[k + COS], motion[k + SIN]
        c_steer, s_steer = (steered_c, steered_s) if axle == 0 else (1.0, 0.0)
        # from the pitched to the heading frame
        x, y, z = p[P_DISTANCE + axle], motion[k + HUB_Y], motion[k + HUB_Z]
        x, z = c * x + s * z, c * z - s * x
        vx, vy, vz = motion[k + HUB_VELOCITY], motion[k + HUB_VELOCITY + 1], 0.0
        vx, vz = (
            c * vx + s * motion[k + HUB_VELOCITY + 2],
            c * motion[k + HUB_VELOCITY + 2] - s * vx,
        )
        wx, wy, wz = ox + motion[k + TILT_RATE], oy, oz
        wx, wz = c * wx + s * wz, c * wz - s * wx
        across_x, across_y, across_z = s * s_tilt, c_tilt, c * s_tilt
        spin_x, spin_y, spin_z = -s_steer, c_steer * c_tilt, c_steer * s_tilt
        spin_x, spin_z = c * spin_x + s * spin_z, c * spin_z - s * spin_x
        # without the carrier's turn about the wheel axis, which the spin contains
        turned = wx * spin_x + wy * spin_y + wz * spin_z
        rx, ry, rz = wx - turned * spin_x, wy - turned * spin_y, wz - turned * spin_z
        steeper = 1.0 / (1.0 - spin_z * spin_z)
        longer = sqrt(steeper)
        unloaded = p[P_UNLOADED + axle]
        drive = drive_per_load * p[P_STATIC + axle]
        fx, fy, fz, nx, ny, nz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for side in range(2):
            wheel = 2 * axle + side
            t = track if side == 0 else -track
            hub_x, hub_y, hub_z = x + t * across_x, y + t * across_y, z + t * across_z
            above = height + hub_z - inputs[ports.ROAD_HEIGHT + wheel]
            lean = above * spin_z * steeper
            dx, dy, dz = lean * spin_x, lean * spin_y, -above
            contact_x = vx + t * (wy * across_z - wz * across_y) + ry * dz - rz * dy
            contact_y = vy + t * (wz * across_x - wx * across_z) + rz * dx - rx * dz
            contact_z = vz + t * (wx * across_y - wy * across_x) + rx * dy - ry * dx
            load = longer * normal_force(
                p[P_TYRE_STIFFNESS],
                p[P_TYRE_DAMPING],
                unloaded - above * longer,
                contact_z * longer,
            )
            along = (contact_x * spin_y - contact_y * spin_x) * longer
            across = (contact_x * spin_x + contact_y * spin_y) * longer
            spin, slip = state[SPIN + wheel], state[SLIP + wheel]
            ahead, aside = tyre_forces(p, axle, friction, load, along, spin * radius, slip)
            rolling = max(abs(along), SLOWEST_ROLLING) * per_relaxation
            rate[SLIP + wheel] = rolling * (-across / max(abs(along), SLOWEST) - slip)
            # no step at standstill
            towards = spin / max(abs(spin), 1.0)
            resistance = p[P_ROLLING] * load * towards
            torque = (drive - inputs[ports.BRAKE_FORCE + wheel] * towards) * radius
            rate[SPIN + wheel] = (torque - (ahead + resistance) * radius) * per_inertia
            force_x = (ahead * spin_y + aside * spin_x) * longer
            force_y = (aside * spin_y - ahead * spin_x) * longer
            moment_x = (hub_y + dy) * load - (hub_z + dz) * force_y
            moment_y = (hub_z + dz) * force_x - (hub_x + dx) * load
            moment_z = (hub_x + dx) * force_y - (hub_y + dy) * force_x
            about = (
                spin_x * (dy * load - dz * force_y)
                + spin_y * (dz * force_x - dx * load)
                + spin_z * (dx * force_y - dy * force_x)
            )
            # the wheel turns freely but for the shaft's torque; as a gyrostat it resists
            held, spun = about + torque, p[P_SPIN_INERTIA] * spin
            fx, fy, fz = fx + force_x, fy + force_y, fz + load
            nx += moment_x - held * spin_x - spun * (wy * spin_z - wz * spin_y)
            ny += moment_y - held * spin_y - spun * (wz * spin_x - wx * spin_z)
            nz += moment_z - held * spin_z - spun * (wx * spin_y - wy * spin_x)
            results[R_LOAD + wheel] = load
            results[R_LONGITUDINAL + wheel], results[R_LATERAL + wheel] = ahead, aside
            results[R_SIDE + wheel] = force_y
            results[R_GAP + wheel] = max(above * longer - unloaded, 0.0)
            results[R_COUPLE + wheel] = -(ahead + resistance) * radius - about
            results[R_SHAFT + wheel] = torque
        total_x, total_y = total_x + fx, total_y + fy
        forces[f + FORCE], forces[f + FORCE + 1] = c * fx - s * fz, fy
        forces[f + FORCE + 2] = s * fx + c * fz
        forces[f + MOMENT], forces[f + MOMENT + 1] = c * nx - s * nz, ny
        forces[f + MOMENT + 2] = s * nx + c * nz
    results[R_ACC] = total_x / p[P_MASS] - GRAVITY * motion[UP]
    results[R_ACC + 1] = total_y / p[P_MASS] - GRAVITY * motion[UP + 1]


@njit
def evaluate(state: Vector, inputs: Vector, p: Vector, rate: Vector, results: Vector) -> None:
    """Fill ``rate`` with the time derivative of ``state``, and the algebraic ``results``."""
    motion, forces, found, slides = _motion(), _forces(), _found(), _slides()
    for axle in range(2):
        left, right, track = TRAVEL + 2 * axle, TRAVEL + 2 * axle + 1, p[P_TRACK + axle]
        for n in range(2):
            a, b = state[left + 4 * n], state[right + 4 * n]
            slides[4 * axle + 2 * n] = -0.5 * (a + b)
            slides[4 * axle + 2 * n + 1] = -0.5 * (a - b) / track
    rigid_car.place(state[PITCH], state[ROLL], state[VX:HEAVE], slides, inputs, p, motion)
    _suspension(state, inputs, p, results, forces)
    _road_forces(state, inputs, p, motion, rate, results, forces)
    rigid_car.accelerate(motion, forces, p, found)

    # the heading frame turns, on a sloping road about its plane's axes as well
    yaw_rate, vx, vy, vz = state[YAW_RATE], state[VX], state[VY], state[HEAVE_RATE]
    turn_x = yaw_rate * motion[UP] / motion[UP + 2]
    turn_y = yaw_rate * motion[UP + 1] / motion[UP + 2]
    height = p[P_AXIS_HEIGHT] + state[HEAVE]
    c_yaw, s_yaw = cos(state[YAW]), sin(state[YAW])
    foot_x, foot_y = vx - turn_y * height, vy + turn_x * height
    rate[X] = foot_x * c_yaw - foot_y * s_yaw
    rate[Y] = foot_x * s_yaw + foot_y * c_yaw
    rate[YAW] = yaw_rate
    rate[VX] = found[POINT_ACC] + yaw_rate * vy - turn_y * vz
    rate[VY] = found[POINT_ACC + 1] - yaw_rate * vx + turn_x * vz
    rate[HEAVE_RATE] = found[POINT_ACC + 2] + turn_y * vx - turn_x * vy
    rate[ROLL_RATE], rate[PITCH_RATE] = found[Q + ROLL_Q], found[Q + PITCH_Q]
    rate[YAW_RATE] = found[Q + YAW_Q]
    rate[HEAVE], rate[ROLL], rate[PITCH] = vz, state[ROLL_RATE], state[PITCH_RATE]
    for wheel in range(4):
        axle = wheel // 2
        track = p[P_TRACK + axle] if wheel % 2 == 0 else -p[P_TRACK + axle]
        slide, tilt = found[Q + SLIDE_Q + 2 * axle], found[Q + TILT_Q + 2 * axle]
        rate[TRAVEL + wheel] = state[TRAVEL_RATE + wheel]
        rate[TRAVEL_RATE + wheel] = -(slide + track * tilt)
    rate[LIFTED_TIME] = 0.0
    rate[ROLLED_OVER] = 0.0
    for n in range(3):
        results[R_BODY_ACC + n] = found[BODY_ACC + n]


@njit
def derivative(state: Vector, inputs: Vector, parameters: Vector, rate: Vector) -> None:
    """Fill ``rate`` with the time derivative of ``state``."""
    evaluate(state, inputs, parameters, rate, _results())


@njit
def _observe(state: Vector, inputs: Vector, p: Vector, outputs: Vector, dt: float) -> None:
    rate, results = _rates(), _results()
    evaluate(state, inputs, p, rate, results)
    c_yaw, s_yaw = cos(state[YAW]), sin(state[YAW])
    yaw_rate, offset, arm = state[YAW_RATE], p[P_OFFSET], p[P_ARM]
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
    outputs[ports.LATERAL_FORCE : ports.LATERAL_FORCE + 4] = results[R_SIDE : R_SIDE + 4]
    outputs[ports.WHEEL_HEIGHT : ports.WHEEL_HEIGHT + 4] = results[R_GAP : R_GAP + 4]
    left_off = results[R_LOAD] == 0.0 and results[R_LOAD + 2] == 0.0
    right_off = results[R_LOAD + 1] == 0.0 and results[R_LOAD + 3] == 0.0
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
