"""Motion at an inertial measurement unit: rigid-body motion of the point where it is mounted.

Body attitude by heading, pitch and roll (z, y, x; ISO 8855 axes) over a road plane tilted by bank
and grade, which turns with the car about the vertical. Exact in the angles.
"""

import math

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.kernels.jit import njit

GRAVITY = 9.81

# Slots of the result: angular rate (rad/s) and specific force (m/s²) along the body's axes.
RATE, FORCE, N_MOTION = 0, 3, 6


def mounting(angles: tuple[float, float, float]) -> NDArray[np.float64]:
    """Rotation of a vector to the axes of a unit misaligned by angles about x, y, z (rad)."""
    (sx, sy, sz), (cx, cy, cz) = np.sin(angles), np.cos(angles)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray((about_z @ about_y @ about_x).T, dtype=np.float64)


@njit
def along(mounting: NDArray[np.float64], axis: int, vector: NDArray[np.float64], at: int) -> float:
    """Component of the vector from ``at`` on along an axis of a unit; ``mounting`` as (9,)."""
    total = 0.0
    for k in range(3):
        total += mounting[3 * axis + k] * vector[at + k]
    return total


@njit
def specific_motion(
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    arm: NDArray[np.float64],
    motion: NDArray[np.float64],
) -> None:
    """Angular rate and specific force at ``arm`` (3, m from the sprung CG, body axes).

    ``inputs`` and ``outputs`` are a body's vectors (``canroll.plant_sim.bodies.ports``); ``motion``
    (6) is filled.
    """
    sr, cr = math.sin(outputs[ports.ROLL]), math.cos(outputs[ports.ROLL])
    sp, cp = math.sin(outputs[ports.PITCH]), math.cos(outputs[ports.PITCH])
    roll1, roll2 = outputs[ports.ROLL_RATE], outputs[ports.ROLL_ACC]
    pitch1, pitch2 = outputs[ports.PITCH_RATE], outputs[ports.PITCH_ACC]
    yaw1, yaw2 = outputs[ports.YAW_RATE], outputs[ports.YAW_ACC]

    # along the heading axes: the vertical, and the angular rate of the heading frame per yaw rate
    bank, grade = inputs[ports.BANK], inputs[ports.GRADE]
    up_x, up_y = math.sin(grade), math.sin(bank) * math.cos(grade)
    up_z = math.cos(bank) * math.cos(grade)
    turn_x, turn_y = up_x / up_z, up_y / up_z

    # angular rate and acceleration: heading frame, pitch about y, roll about the pitched x
    tx, ty = yaw1 * turn_x, yaw1 * turn_y + pitch1
    wx, wy, wz = tx + roll1 * cp, ty, yaw1 - roll1 * sp
    ax = yaw2 * turn_x - pitch1 * yaw1 + roll2 * cp - roll1 * sp * ty
    ay = yaw2 * turn_y + pitch2 + roll1 * (cp * yaw1 + sp * tx)
    az = yaw2 + pitch1 * yaw1 * turn_x - roll2 * sp - roll1 * cp * ty

    x, y = arm[0], cr * arm[1] - sr * arm[2]
    z = sr * arm[1] + cr * arm[2]
    x, z = cp * x + sp * z, cp * z - sp * x
    dx, dy, dz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
    fx = outputs[ports.BODY_ACC] + GRAVITY * up_x + ay * z - az * y + wy * dz - wz * dy
    fy = outputs[ports.BODY_ACC + 1] + GRAVITY * up_y + az * x - ax * z + wz * dx - wx * dz
    fz = outputs[ports.BODY_ACC + 2] + GRAVITY * up_z + ax * y - ay * x + wx * dy - wy * dx

    motion[RATE], motion[FORCE] = cp * wx - sp * wz, cp * fx - sp * fz
    wz, fz = sp * wx + cp * wz, sp * fx + cp * fz
    motion[RATE + 1], motion[FORCE + 1] = cr * wy + sr * wz, cr * fy + sr * fz
    motion[RATE + 2], motion[FORCE + 2] = cr * wz - sr * wy, cr * fz - sr * fy
