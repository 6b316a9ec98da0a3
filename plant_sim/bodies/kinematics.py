"""Where the car's rigid bodies are and how they move: sprung body, two axles and their hubs.

The road plane carries the *heading frame*: x along the heading, y left, z along the normal. It
turns with the yaw rate r about the normal; on a banked or graded road about the vertical k, since
bank and grade are held relative to the car: ω = r (k_x/k_z, k_y/k_z, 1). P is the point of the
sprung body under its CG on the roll axis. Turned by the pitch about y, the heading frame becomes
the *pitched frame*, in which all other motion of the bodies lies in the lateral plane:

- the sprung body rolls by φ about P, its CG the arm h above P;
- an axle slides by s along the body's z and turns by ρ about its roll centre C, which lies at the
  fixed height h_i over the wheels' ground line; its hubs lie half a track to either side of the
  point R − h_i above C.

Quantities of the wheels stand side by side, four for each slot, and the loops over them only fill
such slots: compilers make vector code of that, four wheels at the cost of one.
"""

from math import cos, sin

from canroll.typing import Vector
from plant_sim.bodies.held import TURN, UP
from plant_sim.bodies.parameters import Car
from plant_sim.kernels.jit import inlined
from vehicles import GRAVITY

# Slots of the motion: what position and velocity determine. Vectors are in the pitched frame:
# velocity of P, angular velocity of that frame, the same per yaw rate, the frame's angular
# acceleration for q'' = 0 (its y is 0), weight per mass.
COS_PITCH, SIN_PITCH, COS_ROLL, SIN_ROLL, ROLL_RATE = range(5)
VELOCITY, RATE, PER_YAW, BIAS, WEIGHT = range(5, 20, 3)
# Two each, of the axles.
COS, SIN, CENTRE_Y, CENTRE_Z, SLIDE_RATE, TILT_RATE = range(20, 32, 2)
# Four each, of the hubs: place from P and from the roll centre, velocity.
HUB_Y, HUB_Z, ARM_Y, ARM_Z, HUB_VX, HUB_VY, HUB_VZ = range(32, 60, 4)
N_MOTION = 60

# Slots of the forces, four each: on a hub with its wheel and their moment about P, pitched frame.
# Then of each axle what the suspension exerts along the slide and about the roll centre, and of
# the wind on the body the side force and its moments about P, heading frame.
FORCE_X, FORCE_Y, FORCE_Z, MOMENT_X, MOMENT_Y, MOMENT_Z, SLIDE, TILT = (*range(0, 24, 4), 24, 26)
WIND_Y, WIND_ROLL, WIND_YAW = 28, 29, 30
N_FORCES = 31


@inlined
def of_axle(motion: Vector, slot: int, wheel: int) -> float:
    """An axle's slot of the motion, for a wheel on it."""
    value: float = motion[slot] if wheel < 2 else motion[slot + 1]
    return value


@inlined
def bias(  # noqa: PLR0917
    motion: Vector, x: float, y: float, z: float, y_rate: float, z_rate: float
) -> tuple[float, float, float]:
    """Weight and inertial force per mass on a point that moves in the pitched frame, for q'' = 0.

    Without its acceleration in that frame.
    """
    ox, oy, oz = motion[RATE], motion[RATE + 1], motion[RATE + 2]
    ax, az = motion[BIAS], motion[BIAS + 2]
    along = ox * x + oy * y + oz * z
    square = ox * ox + oy * oy + oz * oz
    return (
        motion[WEIGHT] + az * y - ox * along + square * x - 2.0 * (oy * z_rate - oz * y_rate),
        motion[WEIGHT + 1] - az * x + ax * z - oy * along + square * y + 2.0 * ox * z_rate,
        motion[WEIGHT + 2] - ax * y - oz * along + square * z - 2.0 * ox * y_rate,
    )


@inlined
def place(  # noqa: PLR0917
    pitch: float,
    roll: float,
    rates: Vector,
    slides: Vector,
    held: Vector,
    car: Car,
    motion: Vector,
    forces: Vector,
) -> None:
    """Fill ``motion``, and the ``forces`` of the hubs' weight and inertia for q'' = 0.

    ``rates`` (6): velocity of P in the heading frame, then roll, pitch and yaw rate; ``slides``
    (8): s, ρ, s', ρ' of each axle.
    """
    c, s = cos(pitch), sin(pitch)
    c_roll, s_roll = cos(roll), sin(roll)
    motion[COS_PITCH], motion[SIN_PITCH] = c, s
    motion[COS_ROLL], motion[SIN_ROLL] = c_roll, s_roll
    roll_rate, pitch_rate, yaw_rate = rates[3], rates[4], rates[5]
    motion[ROLL_RATE] = roll_rate
    tx, ty, tz = c * held[TURN] - s, held[TURN + 1], s * held[TURN] + c
    motion[PER_YAW], motion[PER_YAW + 1], motion[PER_YAW + 2] = tx, ty, tz
    vx, vy, vz = c * rates[0] - s * rates[2], rates[1], s * rates[0] + c * rates[2]
    motion[VELOCITY], motion[VELOCITY + 1], motion[VELOCITY + 2] = vx, vy, vz
    ox, oy, oz = yaw_rate * tx, yaw_rate * ty + pitch_rate, yaw_rate * tz
    motion[RATE], motion[RATE + 1], motion[RATE + 2] = ox, oy, oz
    # the pitch axis turns with the heading frame
    motion[BIAS], motion[BIAS + 1], motion[BIAS + 2] = -pitch_rate * oz, 0.0, pitch_rate * ox
    motion[WEIGHT] = -GRAVITY * (c * held[UP] - s * held[UP + 2])
    motion[WEIGHT + 1] = -GRAVITY * held[UP + 1]
    motion[WEIGHT + 2] = -GRAVITY * (s * held[UP] + c * held[UP + 2])
    for axle in range(2):
        tilted = roll + slides[4 * axle + 1]
        motion[COS + axle], motion[SIN + axle] = cos(tilted), sin(tilted)
        up = car.axis_height - car.axle[axle].roll_centre - slides[4 * axle]
        motion[CENTRE_Y + axle], motion[CENTRE_Z + axle] = up * s_roll, -up * c_roll
        motion[SLIDE_RATE + axle] = slides[4 * axle + 2]
        motion[TILT_RATE + axle] = roll_rate + slides[4 * axle + 3]
    for wheel in range(4):
        c_tilt, s_tilt = of_axle(motion, COS, wheel), of_axle(motion, SIN, wheel)
        centre_y, centre_z = of_axle(motion, CENTRE_Y, wheel), of_axle(motion, CENTRE_Z, wheel)
        slide_rate, tilt_rate = (
            of_axle(motion, SLIDE_RATE, wheel),
            of_axle(motion, TILT_RATE, wheel),
        )
        up, side = car.hub_up[wheel], car.side[wheel]
        arm_y, arm_z = side * c_tilt - up * s_tilt, side * s_tilt + up * c_tilt
        x, y, z = car.distance[wheel], centre_y + arm_y, centre_z + arm_z
        moved_y = -centre_z * roll_rate - s_roll * slide_rate - arm_z * tilt_rate
        moved_z = centre_y * roll_rate + c_roll * slide_rate + arm_y * tilt_rate
        motion[HUB_Y + wheel], motion[HUB_Z + wheel] = y, z
        motion[ARM_Y + wheel], motion[ARM_Z + wheel] = arm_y, arm_z
        motion[HUB_VX + wheel] = vx + oy * z - oz * y
        motion[HUB_VY + wheel] = vy + oz * x - ox * z + moved_y
        motion[HUB_VZ + wheel] = vz + ox * y - oy * x + moved_z
        fx, fy, fz = bias(motion, x, y, z, moved_y, moved_z)
        rolling, tilting = roll_rate * roll_rate, tilt_rate * tilt_rate
        coriolis = 2.0 * slide_rate * roll_rate
        fy += rolling * centre_y + coriolis * c_roll + tilting * arm_y
        fz += rolling * centre_z + coriolis * s_roll + tilting * arm_z
        mass = car.hub_mass[wheel]
        fx, fy, fz = mass * fx, mass * fy, mass * fz
        forces[FORCE_X + wheel], forces[FORCE_Y + wheel], forces[FORCE_Z + wheel] = fx, fy, fz
        forces[MOMENT_X + wheel] = y * fz - z * fy
        forces[MOMENT_Y + wheel] = z * fx - x * fz
        forces[MOMENT_Z + wheel] = x * fy - y * fx
