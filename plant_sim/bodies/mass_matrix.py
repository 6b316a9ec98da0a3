"""Mass matrix of the car's rigid bodies, and its factors.

The velocity of a point is A' + Σ e_i q_i', with A' that of P, the rates q' = (θ', r, φ') of the
body and (s', ρ') of each axle, and e_i the *partial velocities*. Kane's equations have the masses
Σ m e_i · e_k of the points, and the inertia of the sprung body's turning. An axle's mass is that of
two points, its hubs.

The axles' own unknowns, which are not coupled to each other, are eliminated first. That leaves six
equations in A and the body's three. All this depends on places only, not on forces: a processor
can be at it while it waits for those.
"""

from typing import Any, TypeAlias

import numpy as np

from canroll.plant_sim.bodies.kinematics import Motion
from canroll.plant_sim.bodies.parameters import Car
from canroll.plant_sim.kernels.jit import inlined, record_of, stack_vector
from canroll.plant_sim.kernels.records import fields
from canroll.typing import Vector

# The base's unknowns: A (3), then these q'' of the body.
PITCH, YAW, ROLL, BASE = 3, 4, 5, 6
# Slots of the factors: the base's L and 1/D. Of each axle the coupling of slide and tilt with the
# base, the latter without what goes through the slide; their inverse masses; the coupling of the
# tilt with the slide, per mass of this.
MATRIX, ON_SLIDE, ON_TILT, PER_SLIDE, PER_TILT, LEAN, N_FACTORS = 0, 36, 48, 60, 62, 64, 66

HUBS = np.dtype(
    fields(
        "f8",
        "x y z yaw_x yaw_y yaw_z pitch_pitch yaw_pitch yaw_yaw roll_pitch roll_yaw roll_roll "
        "slide_yaw slide_roll tilt_y tilt_z tilt_pitch tilt_yaw tilt_roll tilt_slide tilt_tilt",
        4,
    )
)
"""Scratch of the hubs: mass moments and products of the partial velocities."""
Hubs: TypeAlias = Any
_hubs, _hubs_of = stack_vector(HUBS.itemsize // 8), record_of(HUBS)


@inlined
def of_all(four: Vector) -> float:
    """Sum over the four hubs."""
    total: float = (four[0] + four[1]) + (four[2] + four[3])
    return total


@inlined
def of_pair(four: Vector, axle: int) -> float:
    """Sum over an axle's two hubs."""
    total: float = four[2 * axle] + four[2 * axle + 1]
    return total


@inlined
def _base(motion: Motion, car: Car, hubs: Hubs, factors: Vector) -> None:
    """Fill the lower triangle for A and the body's own motion, all masses on it."""
    c_roll, s_roll = motion.cos_roll, motion.sin_roll
    tx, ty, tz = motion.per_yaw[0], motion.per_yaw[1], motion.per_yaw[2]
    mass, y, z = car.sprung_mass, -car.arm * s_roll, car.arm * c_roll
    jx = car.roll_inertia
    jyy, jyz, jzz = inertia(motion, car)
    turn_y, turn_z = jyy * ty + jyz * tz, jyz * ty + jzz * tz
    yaw_x, yaw_y, yaw_z = ty * z - tz * y, -tx * z, tx * y
    my, mz = mass * y, mass * z
    sum_x, sum_y, sum_z = of_all(hubs.x), my + of_all(hubs.y), mz + of_all(hubs.z)
    for k in range(BASE * BASE):
        factors[MATRIX + k] = 0.0
    for k in range(3):
        factors[MATRIX + BASE * k + k] = car.mass
    row = MATRIX + BASE * PITCH
    factors[row], factors[row + 2] = sum_z, -sum_x
    factors[row + PITCH] = jyy + mz * z + of_all(hubs.pitch_pitch)
    row = MATRIX + BASE * YAW
    factors[row] = mass * yaw_x + of_all(hubs.yaw_x)
    factors[row + 1] = mass * yaw_y + of_all(hubs.yaw_y)
    factors[row + 2] = mass * yaw_z + of_all(hubs.yaw_z)
    factors[row + PITCH] = turn_y + mz * yaw_x + of_all(hubs.yaw_pitch)
    square = yaw_x * yaw_x + yaw_y * yaw_y + yaw_z * yaw_z
    turning = tx * jx * tx + ty * turn_y + tz * turn_z
    factors[row + YAW] = turning + mass * square + of_all(hubs.yaw_yaw)
    row = MATRIX + BASE * ROLL
    factors[row + 1], factors[row + 2] = -sum_z, sum_y
    factors[row + PITCH] = of_all(hubs.roll_pitch)
    factors[row + YAW] = jx * tx + my * yaw_z - mz * yaw_y + of_all(hubs.roll_yaw)
    factors[row + ROLL] = jx + my * y + mz * z + of_all(hubs.roll_roll)


@inlined
def inertia(motion: Motion, car: Car) -> tuple[float, float, float]:
    """yy, yz and zz of the sprung body's inertia about its CG, in the pitched frame."""
    c_roll, s_roll = motion.cos_roll, motion.sin_roll
    pitch, yaw = car.pitch_inertia, car.yaw_inertia
    return (
        pitch * c_roll * c_roll + yaw * s_roll * s_roll,
        (pitch - yaw) * s_roll * c_roll,
        pitch * s_roll * s_roll + yaw * c_roll * c_roll,
    )


@inlined
def _eliminate(motion: Motion, car: Car, hubs: Hubs, factors: Vector) -> None:
    """Fill the axles' part and take their unknowns out of the base's; factor what is left."""
    c_roll, s_roll = motion.cos_roll, motion.sin_roll
    for axle in range(2):
        slide, tilt, mass = ON_SLIDE + BASE * axle, ON_TILT + BASE * axle, car.axle[axle].unsprung
        factors[slide + 1], factors[slide + 2] = -mass * s_roll, mass * c_roll
        factors[slide + PITCH] = -of_pair(hubs.x, axle) * c_roll
        factors[slide + YAW] = of_pair(hubs.slide_yaw, axle)
        factors[slide + ROLL] = of_pair(hubs.slide_roll, axle)
        factors[tilt + 1] = of_pair(hubs.tilt_y, axle)
        factors[tilt + 2] = of_pair(hubs.tilt_z, axle)
        factors[tilt + PITCH] = of_pair(hubs.tilt_pitch, axle)
        factors[tilt + YAW] = of_pair(hubs.tilt_yaw, axle)
        factors[tilt + ROLL] = of_pair(hubs.tilt_roll, axle)
        coupling, per_slide = of_pair(hubs.tilt_slide, axle), 1.0 / mass
        lean = per_slide * coupling
        per_tilt = 1.0 / (of_pair(hubs.tilt_tilt, axle) - lean * coupling)
        factors[PER_SLIDE + axle], factors[PER_TILT + axle] = per_slide, per_tilt
        factors[LEAN + axle] = lean
        # neither slide nor tilt moves the axle along x
        for i in range(1, BASE):
            factors[tilt + i] -= lean * factors[slide + i]
        for i in range(1, BASE):
            sliding, tilting = per_slide * factors[slide + i], per_tilt * factors[tilt + i]
            for j in range(1, i + 1):
                factors[MATRIX + BASE * i + j] -= (
                    sliding * factors[slide + j] + tilting * factors[tilt + j]
                )
    # along x the car is coupled with its pitch and yaw alone
    per_mass = 1.0 / factors[MATRIX]
    factors[MATRIX] = per_mass
    for i in range(PITCH, ROLL):
        scaled = per_mass * factors[MATRIX + BASE * i]
        for k in range(i, ROLL):
            factors[MATRIX + BASE * k + i] -= scaled * factors[MATRIX + BASE * k]
        factors[MATRIX + BASE * i] = scaled
    for j in range(1, BASE):
        column = MATRIX + j
        per_pivot = 1.0 / factors[column + BASE * j]
        factors[column + BASE * j] = per_pivot
        for i in range(j + 1, BASE):
            scaled = per_pivot * factors[column + BASE * i]
            for k in range(i, BASE):
                factors[MATRIX + BASE * k + i] -= scaled * factors[column + BASE * k]
            factors[column + BASE * i] = scaled


@inlined
def factor(motion: Motion, car: Car, factors: Vector) -> None:
    """Fill the ``factors`` (N_FACTORS) of the mass matrix."""
    hubs = _hubs_of(_hubs())
    c_roll, s_roll = motion.cos_roll, motion.sin_roll
    tx, ty, tz = motion.per_yaw[0], motion.per_yaw[1], motion.per_yaw[2]
    for wheel in range(4):
        mass = car.hub_mass[wheel]
        x, y, z = car.distance[wheel], motion.hub_y[wheel], motion.hub_z[wheel]
        arm_y, arm_z = motion.arm_y[wheel], motion.arm_z[wheel]
        yaw_x, yaw_y, yaw_z = ty * z - tz * y, tz * x - tx * z, tx * y - ty * x
        mx, my, mz = mass * x, mass * y, mass * z
        tilt_y, tilt_z = -mass * arm_z, mass * arm_y
        hubs.x[wheel], hubs.y[wheel], hubs.z[wheel] = mx, my, mz
        hubs.yaw_x[wheel], hubs.yaw_y[wheel] = mass * yaw_x, mass * yaw_y
        hubs.yaw_z[wheel] = mass * yaw_z
        hubs.pitch_pitch[wheel] = mz * z + mx * x
        hubs.yaw_pitch[wheel] = mz * yaw_x - mx * yaw_z
        hubs.yaw_yaw[wheel] = mass * (yaw_x * yaw_x + yaw_y * yaw_y + yaw_z * yaw_z)
        hubs.roll_pitch[wheel] = -mx * y
        hubs.roll_yaw[wheel] = my * yaw_z - mz * yaw_y
        hubs.roll_roll[wheel] = my * y + mz * z
        hubs.slide_yaw[wheel] = mass * (yaw_z * c_roll - yaw_y * s_roll)
        hubs.slide_roll[wheel] = my * c_roll + mz * s_roll
        hubs.tilt_slide[wheel] = tilt_z * c_roll - tilt_y * s_roll
        hubs.tilt_y[wheel], hubs.tilt_z[wheel] = tilt_y, tilt_z
        hubs.tilt_pitch[wheel] = -tilt_z * x
        hubs.tilt_yaw[wheel] = tilt_y * yaw_y + tilt_z * yaw_z
        hubs.tilt_roll[wheel] = tilt_z * y - tilt_y * z
        hubs.tilt_tilt[wheel] = tilt_z * arm_y - tilt_y * arm_z
    _base(motion, car, hubs, factors)
    _eliminate(motion, car, hubs, factors)


@inlined
def substitute(factors: Vector, right: Vector, axles: Vector) -> None:
    """Solve in place: ``right`` (BASE) of the base, ``axles`` (4) slides then tilts."""
    for axle in range(2):
        slide, tilt = ON_SLIDE + BASE * axle, ON_TILT + BASE * axle
        axles[2 + axle] -= factors[LEAN + axle] * axles[axle]
        axles[axle] *= factors[PER_SLIDE + axle]
        axles[2 + axle] *= factors[PER_TILT + axle]
        for i in range(1, BASE):
            right[i] -= factors[slide + i] * axles[axle] + factors[tilt + i] * axles[2 + axle]
    for i in range(PITCH, ROLL):
        right[i] -= factors[MATRIX + BASE * i] * right[0]
    for j in range(1, BASE):
        for i in range(j + 1, BASE):
            right[i] -= factors[MATRIX + BASE * i + j] * right[j]
    for j in range(BASE):
        right[j] *= factors[MATRIX + BASE * j + j]
    for j in range(BASE - 1, 0, -1):
        for i in range(1, j):
            right[i] -= factors[MATRIX + BASE * j + i] * right[j]
    for i in range(YAW, YAW - 2, -1):
        right[0] -= factors[MATRIX + BASE * i] * right[i]
    for axle in range(2):
        sliding, tilting = 0.0, 0.0
        for i in range(1, BASE):
            sliding += factors[ON_SLIDE + BASE * axle + i] * right[i]
            tilting += factors[ON_TILT + BASE * axle + i] * right[i]
        axles[2 + axle] -= factors[PER_TILT + axle] * tilting
        axles[axle] -= factors[PER_SLIDE + axle] * sliding + factors[LEAN + axle] * axles[2 + axle]
