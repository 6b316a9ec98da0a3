"""Mass matrix of the car's rigid bodies, and its factors.

The velocity of a point is A' + Σ e_i q_i', with A' that of P, the rates q' = (θ', r, φ') of the
body and (s', ρ') of each axle, and e_i the *partial velocities*. Kane's equations have the masses
Σ m e_i · e_k of the points, and the inertia of the sprung body's turning. An axle's mass is that of
two points, its hubs.

The axles' own unknowns, which are not coupled to each other, are eliminated first. That leaves six
equations in A and the body's three. All this depends on places only, not on forces: a processor
can be at it while it waits for those.
"""

from canroll.typing import Vector
from plant_sim.bodies.kinematics import (
    ARM_Y,
    ARM_Z,
    COS_ROLL,
    HUB_Y,
    HUB_Z,
    PER_YAW,
    SIN_ROLL,
)
from plant_sim.bodies.parameters import Car
from plant_sim.kernels.jit import inlined, stack_vector

# The base's unknowns: A (3), then these q'' of the body.
PITCH, YAW, ROLL, BASE = 3, 4, 5, 6
# Slots of the factors: the base's L and 1/D. Of each axle the coupling of slide and tilt with the
# base, the latter without what goes through the slide; their inverse masses; the coupling of the
# tilt with the slide, per mass of this.
MATRIX, ON_SLIDE, ON_TILT, PER_SLIDE, PER_TILT, LEAN, N_FACTORS = 0, 36, 48, 60, 62, 64, 66

# Scratch, four each, of the hubs: mass moments and products of the partial velocities.
(
    X,
    Y,
    Z,
    YAW_X,
    YAW_Y,
    YAW_Z,
    PITCH_PITCH,
    YAW_PITCH,
    YAW_YAW,
    ROLL_PITCH,
    ROLL_YAW,
    ROLL_ROLL,
    SLIDE_YAW,
    SLIDE_ROLL,
    TILT_Y,
    TILT_Z,
    TILT_PITCH,
    TILT_YAW,
    TILT_ROLL,
    TILT_SLIDE,
    TILT_TILT,
) = range(0, 84, 4)
_hubs = stack_vector(84)


@inlined
def of_all(hubs: Vector, slot: int) -> float:
    """Sum over the four hubs."""
    total: float = (hubs[slot] + hubs[slot + 1]) + (hubs[slot + 2] + hubs[slot + 3])
    return total


@inlined
def of_pair(hubs: Vector, slot: int, axle: int) -> float:
    """Sum over an axle's two hubs."""
    total: float = hubs[slot + 2 * axle] + hubs[slot + 2 * axle + 1]
    return total


@inlined
def _base(motion: Vector, car: Car, hubs: Vector, factors: Vector) -> None:
    """Fill the lower triangle for A and the body's own motion, all masses on it."""
    c_roll, s_roll = motion[COS_ROLL], motion[SIN_ROLL]
    tx, ty, tz = motion[PER_YAW], motion[PER_YAW + 1], motion[PER_YAW + 2]
    mass, y, z = car.sprung_mass, -car.arm * s_roll, car.arm * c_roll
    jx = car.roll_inertia
    jyy, jyz, jzz = inertia(motion, car)
    turn_y, turn_z = jyy * ty + jyz * tz, jyz * ty + jzz * tz
    yaw_x, yaw_y, yaw_z = ty * z - tz * y, -tx * z, tx * y
    my, mz = mass * y, mass * z
    sum_x, sum_y, sum_z = of_all(hubs, X), my + of_all(hubs, Y), mz + of_all(hubs, Z)
    for k in range(BASE * BASE):
        factors[MATRIX + k] = 0.0
    for k in range(3):
        factors[MATRIX + BASE * k + k] = car.mass
    row = MATRIX + BASE * PITCH
    factors[row], factors[row + 2] = sum_z, -sum_x
    factors[row + PITCH] = jyy + mz * z + of_all(hubs, PITCH_PITCH)
    row = MATRIX + BASE * YAW
    factors[row] = mass * yaw_x + of_all(hubs, YAW_X)
    factors[row + 1] = mass * yaw_y + of_all(hubs, YAW_Y)
    factors[row + 2] = mass * yaw_z + of_all(hubs, YAW_Z)
    factors[row + PITCH] = turn_y + mz * yaw_x + of_all(hubs, YAW_PITCH)
    square = yaw_x * yaw_x + yaw_y * yaw_y + yaw_z * yaw_z
    turning = tx * jx * tx + ty * turn_y + tz * turn_z
    factors[row + YAW] = turning + mass * square + of_all(hubs, YAW_YAW)
    row = MATRIX + BASE * ROLL
    factors[row + 1], factors[row + 2] = -sum_z, sum_y
    factors[row + PITCH] = of_all(hubs, ROLL_PITCH)
    factors[row + YAW] = jx * tx + my * yaw_z - mz * yaw_y + of_all(hubs, ROLL_YAW)
    factors[row + ROLL] = jx + my * y + mz * z + of_all(hubs, ROLL_ROLL)


@inlined
def inertia(motion: Vector, car: Car) -> tuple[float, float, float]:
    """yy, yz and zz of the sprung body's inertia about its CG, in the pitched frame."""
    c_roll, s_roll = motion[COS_ROLL], motion[SIN_ROLL]
    pitch, yaw = car.pitch_inertia, car.yaw_inertia
    return (
        pitch * c_roll * c_roll + yaw * s_roll * s_roll,
        (pitch - yaw) * s_roll * c_roll,
        pitch * s_roll * s_roll + yaw * c_roll * c_roll,
    )


@inlined
def _eliminate(motion: Vector, car: Car, hubs: Vector, factors: Vector) -> None:
    """Fill the axles' part and take their unknowns out of the base's; factor what is left."""
    c_roll, s_roll = motion[COS_ROLL], motion[SIN_ROLL]
    for axle in range(2):
        slide, tilt, mass = ON_SLIDE + BASE * axle, ON_TILT + BASE * axle, car.axle[axle].unsprung
        factors[slide + 1], factors[slide + 2] = -mass * s_roll, mass * c_roll
        factors[slide + PITCH] = -of_pair(hubs, X, axle) * c_roll
        factors[slide + YAW] = of_pair(hubs, SLIDE_YAW, axle)
        factors[slide + ROLL] = of_pair(hubs, SLIDE_ROLL, axle)
        factors[tilt + 1] = of_pair(hubs, TILT_Y, axle)
        factors[tilt + 2] = of_pair(hubs, TILT_Z, axle)
        factors[tilt + PITCH] = of_pair(hubs, TILT_PITCH, axle)
        factors[tilt + YAW] = of_pair(hubs, TILT_YAW, axle)
        factors[tilt + ROLL] = of_pair(hubs, TILT_ROLL, axle)
        coupling, per_slide = of_pair(hubs, TILT_SLIDE, axle), 1.0 / mass
        lean = per_slide * coupling
        per_tilt = 1.0 / (of_pair(hubs, TILT_TILT, axle) - lean * coupling)
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
def factor(motion: Vector, car: Car, factors: Vector) -> None:
    """Fill the ``factors`` (N_FACTORS) of the mass matrix."""
    hubs = _hubs()
    c_roll, s_roll = motion[COS_ROLL], motion[SIN_ROLL]
    tx, ty, tz = motion[PER_YAW], motion[PER_YAW + 1], motion[PER_YAW + 2]
    for wheel in range(4):
        mass = car.hub_mass[wheel]
        x, y, z = car.distance[wheel], motion[HUB_Y + wheel], motion[HUB_Z + wheel]
        arm_y, arm_z = motion[ARM_Y + wheel], motion[ARM_Z + wheel]
        yaw_x, yaw_y, yaw_z = ty * z - tz * y, tz * x - tx * z, tx * y - ty * x
        mx, my, mz = mass * x, mass * y, mass * z
        tilt_y, tilt_z = -mass * arm_z, mass * arm_y
        hubs[X + wheel], hubs[Y + wheel], hubs[Z + wheel] = mx, my, mz
        hubs[YAW_X + wheel], hubs[YAW_Y + wheel] = mass * yaw_x, mass * yaw_y
        hubs[YAW_Z + wheel] = mass * yaw_z
        hubs[PITCH_PITCH + wheel] = mz * z + mx * x
        hubs[YAW_PITCH + wheel] = mz * yaw_x - mx * yaw_z
        hubs[YAW_YAW + wheel] = mass * (yaw_x * yaw_x + yaw_y * yaw_y + yaw_z * yaw_z)
        hubs[ROLL_PITCH + wheel] = -mx * y
        hubs[ROLL_YAW + wheel] = my * yaw_z - mz * yaw_y
        hubs[ROLL_ROLL + wheel] = my * y + mz * z
        hubs[SLIDE_YAW + wheel] = mass * (yaw_z * c_roll - yaw_y * s_roll)
        hubs[SLIDE_ROLL + wheel] = my * c_roll + mz * s_roll
        hubs[TILT_SLIDE + wheel] = tilt_z * c_roll - tilt_y * s_roll
        hubs[TILT_Y + wheel], hubs[TILT_Z + wheel] = tilt_y, tilt_z
        hubs[TILT_PITCH + wheel] = -tilt_z * x
        hubs[TILT_YAW + wheel] = tilt_y * yaw_y + tilt_z * yaw_z
        hubs[TILT_ROLL + wheel] = tilt_z * y - tilt_y * z
        hubs[TILT_TILT + wheel] = tilt_z * arm_y - tilt_y * arm_z
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
