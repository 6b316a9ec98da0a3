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
from typing import Any, TypeAlias

import numpy as np

from canroll.plant_sim.bodies.held import TURN, UP
from canroll.plant_sim.bodies.parameters import Car
from canroll.plant_sim.kernels.jit import inlined
from canroll.plant_sim.kernels.records import fields
from canroll.typing import Vector
from canroll.vehicles import GRAVITY

MOTION = np.dtype(
    [
        *fields("f8", "cos_pitch sin_pitch cos_roll sin_roll roll_rate"),
        *fields("f8", "velocity rate per_yaw bias weight", 3),
        *fields("f8", "cos sin centre_y centre_z slide_rate tilt_rate", 2),
        *fields("f8", "hub_y hub_z arm_y arm_z hub_vx hub_vy hub_vz", 4),
    ]
)
"""What position and velocity determine.

Vectors are in the pitched frame: velocity of P, angular velocity of that frame, the same per yaw
rate, the frame's angular acceleration for q'' = 0 (its y is 0), weight per mass. Then two each, of
the axles, and four each, of the hubs: place from P and from the roll centre, velocity.
"""
FORCES = np.dtype(
    [
        *fields("f8", "force_x force_y force_z moment_x moment_y moment_z", 4),
        *fields("f8", "slide tilt", 2),
        *fields("f8", "wind_y wind_roll wind_yaw"),
    ]
)
"""Four each: on a hub with its wheel and their moment about P, pitched frame.

Then of each axle what the suspension exerts along the slide and about the roll centre, and of the
wind on the body the side force and its moments about P, heading frame.
"""
Motion: TypeAlias = Any
Forces: TypeAlias = Any


@inlined
def of_axle(both: Vector, wheel: int) -> float:
    """A number of the axles, for a wheel on one."""
    value: float = both[0] if wheel < 2 else both[1]
    return value


@inlined
def bias(  # noqa: PLR0917
    motion: Motion, x: float, y: float, z: float, y_rate: float, z_rate: float
) -> tuple[float, float, float]:
    """Weight and inertial force per mass on a point that moves in the pitched frame, for q'' = 0.

    Without its acceleration in that frame.
    """
    ox, oy, oz = motion.rate[0], motion.rate[1], motion.rate[2]
    ax, az = motion.bias[0], motion.bias[2]
    along = ox * x + oy * y + oz * z
    square = ox * ox + oy * oy + oz * oz
    return (
        motion.weight[0] + az * y - ox * along + square * x - 2.0 * (oy * z_rate - oz * y_rate),
        motion.weight[1] - az * x + ax * z - oy * along + square * y + 2.0 * ox * z_rate,
        motion.weight[2] - ax * y - oz * along + square * z - 2.0 * ox * y_rate,
    )


@inlined
def place(  # noqa: PLR0917
    pitch: float,
    roll: float,
    rates: Vector,
    slides: Vector,
    held: Vector,
    car: Car,
    motion: Motion,
    forces: Forces,
) -> None:
    """Fill ``motion``, and the ``forces`` of the hubs' weight and inertia for q'' = 0.

    ``rates`` (6): velocity of P in the heading frame, then roll, pitch and yaw rate; ``slides``
    (8): s, ρ, s', ρ' of each axle.
    """
    c, s = cos(pitch), sin(pitch)
    c_roll, s_roll = cos(roll), sin(roll)
    motion.cos_pitch, motion.sin_pitch = c, s
    motion.cos_roll, motion.sin_roll = c_roll, s_roll
    roll_rate, pitch_rate, yaw_rate = rates[3], rates[4], rates[5]
    motion.roll_rate = roll_rate
    tx, ty, tz = c * held[TURN] - s, held[TURN + 1], s * held[TURN] + c
    motion.per_yaw[0], motion.per_yaw[1], motion.per_yaw[2] = tx, ty, tz
    vx, vy, vz = c * rates[0] - s * rates[2], rates[1], s * rates[0] + c * rates[2]
    motion.velocity[0], motion.velocity[1], motion.velocity[2] = vx, vy, vz
    ox, oy, oz = yaw_rate * tx, yaw_rate * ty + pitch_rate, yaw_rate * tz
    motion.rate[0], motion.rate[1], motion.rate[2] = ox, oy, oz
    # the pitch axis turns with the heading frame
    motion.bias[0], motion.bias[1], motion.bias[2] = -pitch_rate * oz, 0.0, pitch_rate * ox
    motion.weight[0] = -GRAVITY * (c * held[UP] - s * held[UP + 2])
    motion.weight[1] = -GRAVITY * held[UP + 1]
    motion.weight[2] = -GRAVITY * (s * held[UP] + c * held[UP + 2])
    for axle in range(2):
        tilted = roll + slides[4 * axle + 1]
        motion.cos[axle], motion.sin[axle] = cos(tilted), sin(tilted)
        up = car.axis_height - car.axle[axle].roll_centre - slides[4 * axle]
        motion.centre_y[axle], motion.centre_z[axle] = up * s_roll, -up * c_roll
        motion.slide_rate[axle] = slides[4 * axle + 2]
        motion.tilt_rate[axle] = roll_rate + slides[4 * axle + 3]
    for wheel in range(4):
        c_tilt, s_tilt = of_axle(motion.cos, wheel), of_axle(motion.sin, wheel)
        centre_y, centre_z = of_axle(motion.centre_y, wheel), of_axle(motion.centre_z, wheel)
        slide_rate, tilt_rate = (
            of_axle(motion.slide_rate, wheel),
            of_axle(motion.tilt_rate, wheel),
        )
        up, side = car.hub_up[wheel], car.side[wheel]
        arm_y, arm_z = side * c_tilt - up * s_tilt, side * s_tilt + up * c_tilt
        x, y, z = car.distance[wheel], centre_y + arm_y, centre_z + arm_z
        moved_y = -centre_z * roll_rate - s_roll * slide_rate - arm_z * tilt_rate
        moved_z = centre_y * roll_rate + c_roll * slide_rate + arm_y * tilt_rate
        motion.hub_y[wheel], motion.hub_z[wheel] = y, z
        motion.arm_y[wheel], motion.arm_z[wheel] = arm_y, arm_z
        motion.hub_vx[wheel] = vx + oy * z - oz * y
        motion.hub_vy[wheel] = vy + oz * x - ox * z + moved_y
        motion.hub_vz[wheel] = vz + ox * y - oy * x + moved_z
        fx, fy, fz = bias(motion, x, y, z, moved_y, moved_z)
        rolling, tilting = roll_rate * roll_rate, tilt_rate * tilt_rate
        coriolis = 2.0 * slide_rate * roll_rate
        fy += rolling * centre_y + coriolis * c_roll + tilting * arm_y
        fz += rolling * centre_z + coriolis * s_roll + tilting * arm_z
        mass = car.hub_mass[wheel]
        fx, fy, fz = mass * fx, mass * fy, mass * fz
        forces.force_x[wheel], forces.force_y[wheel], forces.force_z[wheel] = fx, fy, fz
        forces.moment_x[wheel] = y * fz - z * fy
        forces.moment_y[wheel] = z * fx - x * fz
        forces.moment_z[wheel] = x * fy - y * fx
