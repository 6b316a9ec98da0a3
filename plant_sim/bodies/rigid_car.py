"""Equations of motion of the car's rigid bodies: sprung body and two axles, exact in all angles.

Kane's equations with the partial velocities e_i of :mod:`plant_sim.bodies.mass_matrix`:

    Σ m_j (A + Σ e_i q_i'' + b_j) = F                   all masses; b_j: acceleration for q'' = 0
    Σ m_j e_i · (A + Σ e_k q_k'' + b_j) = F_i           each i; the sprung body turns in addition

Vectors are in the pitched frame (:mod:`plant_sim.bodies.kinematics`).
"""

from canroll.typing import Vector
from plant_sim.bodies.kinematics import (
    BIAS,
    CENTRE_Y,
    CENTRE_Z,
    COS_PITCH,
    COS_ROLL,
    FORCE_X,
    FORCE_Y,
    FORCE_Z,
    MOMENT_X,
    MOMENT_Y,
    MOMENT_Z,
    PER_YAW,
    RATE,
    ROLL_RATE,
    SIN_PITCH,
    SIN_ROLL,
    SLIDE,
    TILT,
    WEIGHT,
    WIND_ROLL,
    WIND_Y,
    WIND_YAW,
    bias,
)
from plant_sim.bodies.mass_matrix import (
    BASE,
    PITCH,
    ROLL,
    YAW,
    inertia,
    of_all,
    of_pair,
    substitute,
)
from plant_sim.bodies.parameters import Car
from plant_sim.kernels.jit import inlined, stack_vector

# Slots of the accelerations: of the sprung CG and of P (heading frame), of q.
BODY_ACC, POINT_ACC, PITCH_Q, YAW_Q, ROLL_Q, SLIDE_Q, TILT_Q = 0, 3, 6, 7, 8, 9, 11
N_ACCELERATIONS = 13

_right, _axles = stack_vector(BASE), stack_vector(4)


@inlined
def accelerate(
    motion: Vector, forces: Vector, factors: Vector, car: Car, accelerations: Vector
) -> None:
    """Fill the ``accelerations`` under the ``forces``, by the mass matrix's ``factors``."""
    right, axles = _right(), _axles()
    c, s = motion[COS_PITCH], motion[SIN_PITCH]
    c_roll, s_roll, roll_rate = motion[COS_ROLL], motion[SIN_ROLL], motion[ROLL_RATE]
    ox, oy, oz = motion[RATE], motion[RATE + 1], motion[RATE + 2]
    tx, ty, tz = motion[PER_YAW], motion[PER_YAW + 1], motion[PER_YAW + 2]

    # sprung body: its CG, and its turning about that
    mass, arm = car.sprung_mass, car.arm
    y, z = -arm * s_roll, arm * c_roll
    fx, fy, fz = bias(motion, 0.0, y, z, -z * roll_rate, y * roll_rate)
    bias_x, bias_y, bias_z = fx, fy + roll_rate * roll_rate * y, fz + roll_rate * roll_rate * z
    fx, fy, fz = mass * bias_x, mass * bias_y, mass * bias_z
    jx = car.roll_inertia
    jyy, jyz, jzz = inertia(motion, car)
    wx, ax, ay = ox + roll_rate, motion[BIAS], roll_rate * oz
    az = motion[BIAS + 2] - roll_rate * oy
    hx, hy, hz = jx * wx, jyy * oy + jyz * oz, jyz * oy + jzz * oz
    on_roll = y * fz - z * fy - (jx * ax + oy * hz - oz * hy) + of_all(forces, MOMENT_X)
    on_pitch = z * fx - (jyy * ay + jyz * az + oz * hx - wx * hz) + of_all(forces, MOMENT_Y)
    on_z = -y * fx - (jyz * ay + jzz * az + wx * hy - oy * hx) + of_all(forces, MOMENT_Z)
    # the wind's moments turn with the heading frame
    on_roll += c * forces[WIND_ROLL] - s * forces[WIND_YAW]
    on_z += s * forces[WIND_ROLL] + c * forces[WIND_YAW]
    right[0], right[1] = fx + of_all(forces, FORCE_X), fy + of_all(forces, FORCE_Y)
    right[1] += forces[WIND_Y]
    right[2] = fz + of_all(forces, FORCE_Z)
    right[PITCH], right[ROLL] = on_pitch, on_roll
    right[YAW] = tx * on_roll + ty * on_pitch + tz * on_z

    for axle in range(2):
        fy, fz = of_pair(forces, FORCE_Y, axle), of_pair(forces, FORCE_Z, axle)
        turning = motion[CENTRE_Z + axle] * fy - motion[CENTRE_Y + axle] * fz
        axles[axle] = fz * c_roll - fy * s_roll + forces[SLIDE + axle]
        axles[2 + axle] = of_pair(forces, MOMENT_X, axle) + turning + forces[TILT + axle]
    substitute(factors, right, axles)

    for axle in range(2):
        accelerations[SLIDE_Q + axle], accelerations[TILT_Q + axle] = axles[axle], axles[2 + axle]
    pitch, yaw, roll = right[PITCH], right[YAW], right[ROLL]
    accelerations[PITCH_Q], accelerations[YAW_Q], accelerations[ROLL_Q] = pitch, yaw, roll
    ax, ay, az = right[0], right[1], right[2]
    accelerations[POINT_ACC], accelerations[POINT_ACC + 1], accelerations[POINT_ACC + 2] = (
        c * ax + s * az,
        ay,
        c * az - s * ax,
    )
    wx, wy, wz = yaw * tx + roll, yaw * ty + pitch, yaw * tz
    ax += wy * z - wz * y - bias_x + motion[WEIGHT]
    ay += -wx * z - bias_y + motion[WEIGHT + 1]
    az += wx * y - bias_z + motion[WEIGHT + 2]
    accelerations[BODY_ACC], accelerations[BODY_ACC + 1], accelerations[BODY_ACC + 2] = (
        c * ax + s * az,
        ay,
        c * az - s * ax,
    )
