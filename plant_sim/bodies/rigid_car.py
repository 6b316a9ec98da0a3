"""Equations of motion of the car's rigid bodies: sprung body and two axles, exact in all angles.

The road plane carries the *heading frame*: x along the heading, y left, z along the normal. It
turns with the yaw rate r about the normal; on a banked or graded road about the vertical k, since
bank and grade are held relative to the car: ω = r (k_x/k_z, k_y/k_z, 1). P is the point of the
sprung body under its CG on the roll axis. Turned by the pitch about y, the heading frame becomes
the *pitched frame*, in which all other motion of the bodies lies in the lateral plane:

- the sprung body rolls by φ about P, its CG the arm h above P;
- an axle slides by s along the body's z and turns by ρ about its roll centre C, which lies at the
  fixed height h_i over the wheels' ground line; its hubs lie R − h_i above C.

Newton and Euler for each body, summed so that the forces in the joints cancel, with
A the acceleration of P and q = (θ, ψ, φ, s_f, ρ_f, s_r, ρ_r):

    Σ m_j (A + a_j) = F                                    all bodies
    Σ (p_j × m_j (A + a_j) + J_j α_j + Ω_j × J_j Ω_j) = N  about P, along pitch and yaw axis, and
                                                           along x for the roll φ
    the same of one axle, along the slide and about its roll centre, for s and ρ

a_j and α_j are linear in q''. A is eliminated by the first equation, which leaves seven in q''.
"""

from math import cos, sin

from canroll.typing import Vector
from plant_sim.bodies import held as held_slots
from plant_sim.bodies.parameters import (
    P_ARM,
    P_AXIS_HEIGHT,
    P_DISTANCE,
    P_MASS,
    P_PITCH_INERTIA,
    P_RADIUS,
    P_ROLL_CENTRE,
    P_ROLL_INERTIA,
    P_SPRUNG,
    P_TRACK,
    P_UNSPRUNG,
    P_YAW_INERTIA,
)
from plant_sim.kernels.jit import inlined, stack_vector
from vehicles import GRAVITY

# Slots of the motion: what position and velocity determine. Vectors are in the pitched frame but
# for UP (the vertical), in the heading frame.
COS_PITCH, SIN_PITCH, COS_ROLL, SIN_ROLL = range(4)
UP, TURN, VELOCITY, RATE = 4, 7, 10, 13  # turn: per yaw rate; velocity of P; of the pitched frame
PITCH_RATE, ROLL_RATE, YAW_RATE = 16, 17, 18
AXLE = 19
# Slots of each axle from AXLE on, N_AXLE apart. Places (y, z) are from P.
COS, SIN, CENTRE_Y, CENTRE_Z, HUB_Y, HUB_Z, SLIDE_RATE, TILT_RATE, MOVED_Y, MOVED_Z = range(10)
HUB_VELOCITY = 10
N_AXLE = HUB_VELOCITY + 3
N_MOTION = AXLE + 2 * N_AXLE

# Slots of the forces on an axle and what holds it: from the road, moment about P, from the body.
FORCE, MOMENT, SLIDE, TILT = 0, 3, 6, 7
N_FORCES = 8

# Slots of the accelerations: of the sprung CG and of P (heading frame), then of q.
BODY_ACC, POINT_ACC, Q = 0, 3, 6
PITCH_Q, YAW_Q, ROLL_Q, SLIDE_Q, TILT_Q = 0, 1, 2, 3, 4  # of the front axle; rear: 2 more
N_Q = 7
N_ACCELERATIONS = Q + N_Q

_matrix, _linear = stack_vector(N_Q * N_Q), stack_vector(3 * N_Q)


@inlined
def place(  # noqa: PLR0917
    pitch: float,
    roll: float,
    rates: Vector,
    slides: Vector,
    held: Vector,
    p: Vector,
    motion: Vector,
) -> None:
    """Fill ``motion``.

    ``rates`` (6): velocity of P in the heading frame, then roll, pitch and yaw rate; ``slides``
    (8): s, ρ, s', ρ' of each axle.
    """
    c, s = cos(pitch), sin(pitch)
    c_roll, s_roll = cos(roll), sin(roll)
    motion[COS_PITCH], motion[SIN_PITCH] = c, s
    motion[COS_ROLL], motion[SIN_ROLL] = c_roll, s_roll
    for n in range(3):
        motion[UP + n] = held[held_slots.UP + n]
    ahead, aside = held[held_slots.TURN], held[held_slots.TURN + 1]
    roll_rate, pitch_rate, yaw_rate = rates[3], rates[4], rates[5]
    motion[ROLL_RATE], motion[PITCH_RATE], motion[YAW_RATE] = roll_rate, pitch_rate, yaw_rate
    motion[TURN], motion[TURN + 1], motion[TURN + 2] = c * ahead - s, aside, s * ahead + c
    vx, vy = c * rates[0] - s * rates[2], rates[1]
    vz = s * rates[0] + c * rates[2]
    motion[VELOCITY], motion[VELOCITY + 1], motion[VELOCITY + 2] = vx, vy, vz
    ox, oy, oz = (
        yaw_rate * motion[TURN],
        yaw_rate * motion[TURN + 1] + pitch_rate,
        yaw_rate * motion[TURN + 2],
    )
    motion[RATE], motion[RATE + 1], motion[RATE + 2] = ox, oy, oz
    for axle in range(2):
        k = AXLE + N_AXLE * axle
        slide, tilt = slides[4 * axle], slides[4 * axle + 1]
        slide_rate, tilt_rate = slides[4 * axle + 2], roll_rate + slides[4 * axle + 3]
        c_tilt, s_tilt = cos(roll + tilt), sin(roll + tilt)
        down = p[P_ROLL_CENTRE + axle] - p[P_AXIS_HEIGHT] + slide
        up = p[P_RADIUS] - p[P_ROLL_CENTRE + axle]
        centre_y, centre_z = -down * s_roll, down * c_roll
        arm_y, arm_z = -up * s_tilt, up * c_tilt
        x, y, z = p[P_DISTANCE + axle], centre_y + arm_y, centre_z + arm_z
        motion[k + COS], motion[k + SIN] = c_tilt, s_tilt
        motion[k + CENTRE_Y], motion[k + CENTRE_Z] = centre_y, centre_z
        motion[k + HUB_Y], motion[k + HUB_Z] = y, z
        motion[k + SLIDE_RATE], motion[k + TILT_RATE] = slide_rate, tilt_rate
        moved_y = -centre_z * roll_rate - s_roll * slide_rate - arm_z * tilt_rate
        moved_z = centre_y * roll_rate + c_roll * slide_rate + arm_y * tilt_rate
        motion[k + MOVED_Y], motion[k + MOVED_Z] = moved_y, moved_z
        motion[k + HUB_VELOCITY] = vx + oy * z - oz * y
        motion[k + HUB_VELOCITY + 1] = vy + oz * x - ox * z + moved_y
        motion[k + HUB_VELOCITY + 2] = vz + ox * y - oy * x + moved_z


@inlined
def _inertial(  # noqa: PLR0917
    motion: Vector,
    mass: float,
    x: float,
    y: float,
    z: float,
    y_rate: float,
    z_rate: float,
    y_bias: float,
    z_bias: float,
    turned: float,
    jx: float,
    jyy: float,
    jyz: float,
    jzz: float,
) -> tuple[float, float, float, float, float, float]:
    """Weight and inertial force (3) of a body and its moment (3) about P for q'' = 0.

    The body's CG lies at (x, y, z) from P and moves there in the pitched frame; the body turns with
    ``turned`` about x of it.
    """
    ox, oy, oz = motion[RATE], motion[RATE + 1], motion[RATE + 2]
    c, s = motion[COS_PITCH], motion[SIN_PITCH]
    pitch_rate, yaw_rate = motion[PITCH_RATE], motion[YAW_RATE]
    # the pitch axis turns with the heading frame
    ax = -pitch_rate * yaw_rate * motion[TURN + 2]
    az = pitch_rate * yaw_rate * motion[TURN]
    along = ox * x + oy * y + oz * z
    square = ox * ox + oy * oy + oz * oz
    bx = -az * y + ox * along - square * x + 2.0 * (oy * z_rate - oz * y_rate)
    by = az * x - ax * z + oy * along - square * y - 2.0 * ox * z_rate + y_bias
    bz = ax * y + oz * along - square * z + 2.0 * ox * y_rate + z_bias
    fx = -mass * (GRAVITY * (c * motion[UP] - s * motion[UP + 2]) + bx)
    fy = -mass * (GRAVITY * motion[UP + 1] + by)
    fz = -mass * (GRAVITY * (s * motion[UP] + c * motion[UP + 2]) + bz)
    wx = ox + turned
    ay, az = turned * oz, az - turned * oy
    hx, hy, hz = jx * wx, jyy * oy + jyz * oz, jyz * oy + jzz * oz
    return (
        fx,
        fy,
        fz,
        y * fz - z * fy - (jx * ax + oy * hz - oz * hy),
        z * fx - x * fz - (jyy * ay + jyz * az + oz * hx - wx * hz),
        x * fy - y * fx - (jyz * ay + jzz * az + wx * hy - oy * hx),
    )


@inlined
def accelerate(motion: Vector, forces: Vector, p: Vector, found: Vector) -> None:
    """Fill the accelerations ``found`` under the ``forces`` on both axles.

    ``forces`` has N_FORCES an axle: force and moment about P from the road, in the pitched frame,
    and what the suspension exerts along the slide and about the roll centre.
    """
    matrix, linear = _matrix(), _linear()
    c_roll, s_roll = motion[COS_ROLL], motion[SIN_ROLL]
    roll_rate = motion[ROLL_RATE]
    tx, ty, tz = motion[TURN], motion[TURN + 1], motion[TURN + 2]
    for i in range(N_Q * N_Q):
        matrix[i] = 0.0

    # sprung body
    mass, arm = p[P_SPRUNG], p[P_ARM]
    y, z = -arm * s_roll, arm * c_roll
    jx = p[P_ROLL_INERTIA]
    jyy = p[P_PITCH_INERTIA] * c_roll * c_roll + p[P_YAW_INERTIA] * s_roll * s_roll
    jzz = p[P_PITCH_INERTIA] * s_roll * s_roll + p[P_YAW_INERTIA] * c_roll * c_roll
    jyz = (p[P_PITCH_INERTIA] - p[P_YAW_INERTIA]) * s_roll * c_roll
    squared = roll_rate * roll_rate
    fx, fy, fz, nx, ny, nz = _inertial(
        motion,
        mass,
        0.0,
        y,
        z,
        -z * roll_rate,
        y * roll_rate,
        -squared * y,
        -squared * z,
        roll_rate,
        jx,
        jyy,
        jyz,
        jzz,
    )
    body_x, body_y, body_z = fx / mass, fy / mass, fz / mass
    sy, sz, sx = mass * y, mass * z, 0.0
    ixx, iyy, izz = jx + mass * (y * y + z * z), jyy + mass * z * z, jzz + mass * y * y
    ixy, ixz, iyz = 0.0, 0.0, jyz - mass * y * z
    roll_y, roll_z = -sz, sy
    roll_inertia, roll_about_y, roll_about_z = ixx, 0.0, 0.0

    for axle in range(2):
        k, f = AXLE + N_AXLE * axle, N_FORCES * axle
        i, j = SLIDE_Q + 2 * axle, TILT_Q + 2 * axle
        mass, track = p[P_UNSPRUNG + axle], p[P_TRACK + axle]
        c, s = motion[k + COS], motion[k + SIN]
        centre_y, centre_z = motion[k + CENTRE_Y], motion[k + CENTRE_Z]
        x, y, z = p[P_DISTANCE + axle], motion[k + HUB_Y], motion[k + HUB_Z]
        arm_y, arm_z = y - centre_y, z - centre_z
        slide_rate, tilt_rate = motion[k + SLIDE_RATE], motion[k + TILT_RATE]
        jx = mass * track * track
        jyy, jzz, jyz = jx * s * s, jx * c * c, -jx * s * c
        squared_tilt, coriolis = tilt_rate * tilt_rate, 2.0 * slide_rate * roll_rate
        gx, gy, gz, mx, my, mz = _inertial(
            motion,
            mass,
            x,
            y,
            z,
            motion[k + MOVED_Y],
            motion[k + MOVED_Z],
            -squared * centre_y - coriolis * c_roll - squared_tilt * arm_y,
            -squared * centre_z - coriolis * s_roll - squared_tilt * arm_z,
            tilt_rate,
            jx,
            jyy,
            jyz,
            jzz,
        )
        gx, gy, gz = gx + forces[f + FORCE], gy + forces[f + FORCE + 1], gz + forces[f + FORCE + 2]
        mx, my = mx + forces[f + MOMENT], my + forces[f + MOMENT + 1]
        mz += forces[f + MOMENT + 2]
        fx, fy, fz = fx + gx, fy + gy, fz + gz
        nx, ny, nz = nx + mx, ny + my, nz + mz
        sx, sy, sz = sx + mass * x, sy + mass * y, sz + mass * z
        ixx += jx + mass * (y * y + z * z)
        iyy += jyy + mass * (x * x + z * z)
        izz += jzz + mass * (x * x + y * y)
        ixy -= mass * x * y
        ixz -= mass * x * z
        iyz += jyz - mass * y * z
        # momentum per rate: of the roll about P, of the slide, of the tilt about the roll centre
        roll_y -= mass * z
        roll_z += mass * y
        roll_inertia += jx + mass * (y * y + z * z)
        roll_about_y -= mass * x * y
        roll_about_z -= mass * x * z
        slide_y, slide_z = -mass * s_roll, mass * c_roll
        tilt_y, tilt_z = -mass * arm_z, mass * arm_y
        slide_about_x, tilt_about_x = (
            y * slide_z - z * slide_y,
            y * tilt_z - z * tilt_y + jx,
        )
        linear[3 * i], linear[3 * i + 1], linear[3 * i + 2] = 0.0, slide_y, slide_z
        linear[3 * j], linear[3 * j + 1], linear[3 * j + 2] = 0.0, tilt_y, tilt_z
        found[Q + i] = gz * c_roll - gy * s_roll + forces[f + SLIDE]
        found[Q + j] = mx - centre_y * gz + centre_z * gy + forces[f + TILT]
        matrix[i * N_Q + PITCH_Q] = -x * slide_z
        matrix[j * N_Q + PITCH_Q] = -x * tilt_z
        matrix[i * N_Q + YAW_Q] = tx * slide_about_x - ty * x * slide_z + tz * x * slide_y
        matrix[j * N_Q + YAW_Q] = tx * tilt_about_x - ty * x * tilt_z + tz * x * tilt_y
        matrix[i * N_Q + ROLL_Q] = slide_about_x
        matrix[j * N_Q + ROLL_Q] = tilt_about_x
        matrix[i * N_Q + i] = mass
        matrix[j * N_Q + i] = arm_y * slide_z - arm_z * slide_y
        matrix[j * N_Q + j] = jx + mass * (arm_y * arm_y + arm_z * arm_z)

    about_x = ixx * tx + ixy * ty + ixz * tz
    about_y = ixy * tx + iyy * ty + iyz * tz
    about_z = ixz * tx + iyz * ty + izz * tz
    matrix[PITCH_Q * N_Q + PITCH_Q] = iyy
    matrix[YAW_Q * N_Q + PITCH_Q] = about_y
    matrix[YAW_Q * N_Q + YAW_Q] = tx * about_x + ty * about_y + tz * about_z
    matrix[ROLL_Q * N_Q + PITCH_Q] = roll_about_y
    matrix[ROLL_Q * N_Q + YAW_Q] = tx * roll_inertia + ty * roll_about_y + tz * roll_about_z
    matrix[ROLL_Q * N_Q + ROLL_Q] = roll_inertia
    linear[0], linear[1], linear[2] = sz, 0.0, -sx
    linear[3], linear[4], linear[5] = ty * sz - tz * sy, tz * sx - tx * sz, tx * sy - ty * sx
    linear[6], linear[7], linear[8] = 0.0, roll_y, roll_z
    found[Q + PITCH_Q] = ny
    found[Q + YAW_Q] = tx * nx + ty * ny + tz * nz
    found[Q + ROLL_Q] = nx

    share = 1.0 / p[P_MASS]
    for i in range(N_Q):
        gx, gy, gz = share * linear[3 * i], share * linear[3 * i + 1], share * linear[3 * i + 2]
        found[Q + i] -= gx * fx + gy * fy + gz * fz
        for j in range(i + 1):
            matrix[i * N_Q + j] -= (
                gx * linear[3 * j] + gy * linear[3 * j + 1] + gz * linear[3 * j + 2]
            )
    _solve(matrix, found)
    for i in range(N_Q):
        fx -= linear[3 * i] * found[Q + i]
        fy -= linear[3 * i + 1] * found[Q + i]
        fz -= linear[3 * i + 2] * found[Q + i]
    fx, fy, fz = share * fx, share * fy, share * fz
    _finish(motion, p, fx, fy, fz, body_x, body_y, body_z, found)


@inlined
def _finish(  # noqa: PLR0917
    motion: Vector,
    p: Vector,
    ax: float,
    ay: float,
    az: float,
    bias_x: float,
    bias_y: float,
    bias_z: float,
    found: Vector,
) -> None:
    """Fill the accelerations of P and of the sprung CG; ``bias`` is weight less that at q'' = 0."""
    c, s = motion[COS_PITCH], motion[SIN_PITCH]
    y, z = -p[P_ARM] * motion[SIN_ROLL], p[P_ARM] * motion[COS_ROLL]
    pitch, yaw, roll = found[Q + PITCH_Q], found[Q + YAW_Q], found[Q + ROLL_Q]
    wx, wy, wz = (
        yaw * motion[TURN] + roll,
        yaw * motion[TURN + 1] + pitch,
        yaw * motion[TURN + 2],
    )
    bx = ax + wy * z - wz * y - bias_x - GRAVITY * (c * motion[UP] - s * motion[UP + 2])
    by = ay - wx * z - bias_y - GRAVITY * motion[UP + 1]
    bz = az + wx * y - bias_z - GRAVITY * (s * motion[UP] + c * motion[UP + 2])
    found[BODY_ACC], found[BODY_ACC + 1], found[BODY_ACC + 2] = c * bx + s * bz, by, c * bz - s * bx
    found[POINT_ACC], found[POINT_ACC + 1] = c * ax + s * az, ay
    found[POINT_ACC + 2] = c * az - s * ax


@inlined
def _solve(matrix: Vector, found: Vector) -> None:
    """Solve for q'' in place: L D Lᵀ of the lower triangle, which is overwritten."""
    for i in range(N_Q):
        for j in range(i):
            total = matrix[i * N_Q + j]
            for k in range(j):
                total -= matrix[i * N_Q + k] * matrix[j * N_Q + k]
            matrix[i * N_Q + j] = total
            # row i holds L D until its own pivot is made
        pivot = matrix[i * N_Q + i]
        for j in range(i):
            scaled = matrix[i * N_Q + j] * matrix[j * N_Q + j]
            pivot -= matrix[i * N_Q + j] * scaled
            matrix[i * N_Q + j] = scaled
        matrix[i * N_Q + i] = 1.0 / pivot
    for i in range(N_Q):
        for j in range(i):
            found[Q + i] -= matrix[i * N_Q + j] * found[Q + j]
    for i in range(N_Q):
        found[Q + i] *= matrix[i * N_Q + i]
    for i in range(N_Q - 1, -1, -1):
        for j in range(i + 1, N_Q):
            found[Q + i] -= matrix[j * N_Q + i] * found[Q + j]
