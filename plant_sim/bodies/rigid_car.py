"""Equations of motion of the car's rigid bodies: sprung body and two axles, exact in all angles.

Kane's equations with the partial velocities e_i of :mod:`canroll.plant_sim.bodies.mass_matrix`:

    Σ m_j (A + Σ e_i q_i'' + b_j) = F                   all masses; b_j: acceleration for q'' = 0
    Σ m_j e_i · (A + Σ e_k q_k'' + b_j) = F_i           each i; the sprung body turns in addition

Vectors are in the pitched frame (:mod:`canroll.plant_sim.bodies.kinematics`).
"""

from typing import Any

import numpy as np

from canroll.plant_sim.bodies.kinematics import Forces, Motion, bias
from canroll.plant_sim.bodies.mass_matrix import (
    BASE,
    PITCH,
    ROLL,
    YAW,
    inertia,
    of_all,
    of_pair,
    substitute,
)
from canroll.plant_sim.bodies.parameters import Car
from canroll.plant_sim.kernels.jit import inlined, stack_vector
from canroll.plant_sim.kernels.records import fields
from canroll.typing import Vector

ACCELERATIONS = np.dtype(
    [
        *fields("f8", "body_acc point_acc", 3),
        *fields("f8", "pitch_q yaw_q roll_q"),
        *fields("f8", "slide_q tilt_q", 2),
    ]
)
"""Of the sprung CG and of P (heading frame), then of q."""

_right, _axles = stack_vector(BASE), stack_vector(4)


@inlined
def accelerate(
    motion: Motion,
    forces: Forces,
    factors: Vector,
    car: Car,
    accelerations: Any,  # noqa: ANN401
) -> None:
    """Fill the ``accelerations`` under the ``forces``, by the mass matrix's ``factors``."""
    right, axles = _right(), _axles()
    c, s = motion.cos_pitch, motion.sin_pitch
    c_roll, s_roll, roll_rate = motion.cos_roll, motion.sin_roll, motion.roll_rate
    ox, oy, oz = motion.rate[0], motion.rate[1], motion.rate[2]
    tx, ty, tz = motion.per_yaw[0], motion.per_yaw[1], motion.per_yaw[2]

    # sprung body: its CG, and its turning about that
    mass, arm = car.sprung_mass, car.arm
    y, z = -arm * s_roll, arm * c_roll
    fx, fy, fz = bias(motion, 0.0, y, z, -z * roll_rate, y * roll_rate)
    bias_x, bias_y, bias_z = fx, fy + roll_rate * roll_rate * y, fz + roll_rate * roll_rate * z
    fx, fy, fz = mass * bias_x, mass * bias_y, mass * bias_z
    jx = car.roll_inertia
    jyy, jyz, jzz = inertia(motion, car)
    wx, ax, ay = ox + roll_rate, motion.bias[0], roll_rate * oz
    az = motion.bias[2] - roll_rate * oy
    hx, hy, hz = jx * wx, jyy * oy + jyz * oz, jyz * oy + jzz * oz
    on_roll = y * fz - z * fy - (jx * ax + oy * hz - oz * hy) + of_all(forces.moment_x)
    on_pitch = z * fx - (jyy * ay + jyz * az + oz * hx - wx * hz) + of_all(forces.moment_y)
    on_z = -y * fx - (jyz * ay + jzz * az + wx * hy - oy * hx) + of_all(forces.moment_z)
    # the wind's moments turn with the heading frame
    on_roll += c * forces.wind_roll - s * forces.wind_yaw
    on_z += s * forces.wind_roll + c * forces.wind_yaw
    right[0], right[1] = fx + of_all(forces.force_x), fy + of_all(forces.force_y)
    right[1] += forces.wind_y
    right[2] = fz + of_all(forces.force_z)
    right[PITCH], right[ROLL] = on_pitch, on_roll
    right[YAW] = tx * on_roll + ty * on_pitch + tz * on_z

    for axle in range(2):
        fy, fz = of_pair(forces.force_y, axle), of_pair(forces.force_z, axle)
        turning = motion.centre_z[axle] * fy - motion.centre_y[axle] * fz
        axles[axle] = fz * c_roll - fy * s_roll + forces.slide[axle]
        axles[2 + axle] = of_pair(forces.moment_x, axle) + turning + forces.tilt[axle]
    substitute(factors, right, axles)

    for axle in range(2):
        accelerations.slide_q[axle], accelerations.tilt_q[axle] = axles[axle], axles[2 + axle]
    pitch, yaw, roll = right[PITCH], right[YAW], right[ROLL]
    accelerations.pitch_q, accelerations.yaw_q, accelerations.roll_q = pitch, yaw, roll
    ax, ay, az = right[0], right[1], right[2]
    accelerations.point_acc[0], accelerations.point_acc[1], accelerations.point_acc[2] = (
        c * ax + s * az,
        ay,
        c * az - s * ax,
    )
    wx, wy, wz = yaw * tx + roll, yaw * ty + pitch, yaw * tz
    ax += wy * z - wz * y - bias_x + motion.weight[0]
    ay += -wx * z - bias_y + motion.weight[1]
    az += wx * y - bias_z + motion.weight[2]
    accelerations.body_acc[0], accelerations.body_acc[1], accelerations.body_acc[2] = (
        c * ax + s * az,
        ay,
        c * az - s * ax,
    )
