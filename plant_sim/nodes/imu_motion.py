"""Motion at an inertial measurement unit: rigid-body motion of the point where it is mounted.

Body attitude by heading, pitch and roll (z, y, x; ISO 8855 axes) over a road plane tilted by bank
and grade. Exact in the angles, without small-angle approximations.
"""

import math

import numpy as np
from numpy.typing import NDArray

from plant_sim.bodies import ports
from plant_sim.kernels.jit import njit

GRAVITY = 9.81

# Slots of the result: angular rate (rad/s) and specific force (m/s²) along the body's axes.
RATE, FORCE, N_MOTION = 0, 3, 6


@njit
def specific_motion(
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    arm: NDArray[np.float64],
    motion: NDArray[np.float64],
) -> None:
    """Angular rate and specific force at ``arm`` (3, m from the sprung CG, body axes).

    ``inputs`` and ``outputs`` are a body's vectors (``plant_sim.bodies.ports``); ``motion`` (6) is
    filled. Angular rates follow from the Euler rates, the pitch × yaw part of roll included.
    """
    sr, cr = math.sin(outputs[ports.ROLL]), math.cos(outputs[ports.ROLL])
    sp, cp = math.sin(outputs[ports.PITCH]), math.cos(outputs[ports.PITCH])
    roll1, roll2 = outputs[ports.ROLL_RATE], outputs[ports.ROLL_ACC]
    pitch1, pitch2 = outputs[ports.PITCH_RATE], outputs[ports.PITCH_ACC]
    yaw1, yaw2 = outputs[ports.YAW_RATE], outputs[ports.YAW_ACC]

    p = roll1 - yaw1 * sp
    q = pitch1 * cr + yaw1 * cp * sr
    r = -pitch1 * sr + yaw1 * cp * cr
    p1 = roll2 - yaw2 * sp - yaw1 * pitch1 * cp
    q1 = pitch2 * cr - pitch1 * roll1 * sr + yaw2 * cp * sr
    q1 += yaw1 * (roll1 * cp * cr - pitch1 * sp * sr)
    r1 = -pitch2 * sr - pitch1 * roll1 * cr + yaw2 * cp * cr
    r1 -= yaw1 * (pitch1 * sp * cr + roll1 * cp * sr)

    # The road's normal leans left with the right side up and back on a climb.
    bank, grade = inputs[ports.BANK], inputs[ports.GRADE]
    x = outputs[ports.AX] + GRAVITY * math.sin(grade)
    y = outputs[ports.AY] + GRAVITY * math.sin(bank) * math.cos(grade)
    z = outputs[ports.HEAVE_ACC] + GRAVITY * math.cos(bank) * math.cos(grade)
    along = cp * x - sp * z
    up = sp * x + cp * z

    ax, ay, az = arm[0], arm[1], arm[2]
    cross_x, cross_y, cross_z = q * az - r * ay, r * ax - p * az, p * ay - q * ax
    motion[RATE] = p
    motion[RATE + 1] = q
    motion[RATE + 2] = r
    motion[FORCE] = along + q1 * az - r1 * ay + q * cross_z - r * cross_y
    motion[FORCE + 1] = cr * y + sr * up + r1 * ax - p1 * az + r * cross_x - p * cross_z
    motion[FORCE + 2] = -sr * y + cr * up + p1 * ay - q1 * ax + p * cross_y - q * cross_x
