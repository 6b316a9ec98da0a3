"""Contact of the four tyres with the road: forces on the axles, rates of spins and slips.

A wheel touches the road at its lowest line. The lateral slip is taken there, with a relaxation
length; so are the forces on the axle. Spin and slip refer to one effective rolling radius. A
spinning wheel is a gyrostat on its axle, with drive and brake torque between the two.

Tables of toe turn a wheel as steering does, and the steering gives way to the moments about both
kingpins together. Tables of camber incline it about its contact patch,
for its tyre alone: where the patch is follows from the roll centre. Camber over compression is to
the body; without it a wheel leans as its axle does. Toe and camber do no work by themselves.

Compliance is that to the forces of this very instant, so that a steady state is exact. There is no
loop through the slip, which is a state and builds up more slowly. What is left, a thrust by camber
and a slip ratio that the toe changes, is solved by repetition: each leaves a few hundredths of the
rest, three some 1e-6 of the wheel load.

Vectors are in the heading frame. Quantities of the wheels stand side by side, four for each slot,
and the loops over them only fill such slots: compilers make vector code of that, four wheels at
the cost of one. The forces of the tyres, whose curves are no such code, have a loop for themselves.
"""

from math import cos, sin, sqrt
from typing import Any, TypeAlias

import numpy as np

from canroll.plant_sim.bodies import curves, ports, tyre
from canroll.plant_sim.bodies.held import DRIVE, STEER_COS, STEER_SIN, STEERED
from canroll.plant_sim.bodies.kinematics import Forces, Motion, of_axle
from canroll.plant_sim.bodies.parameters import Car
from canroll.plant_sim.kernels.jit import inlined, record_of, stack_vector
from canroll.plant_sim.kernels.records import fields
from canroll.typing import Vector

SLOWEST = 4.0
"""Speed (m/s) below which slips are no longer referred to the wheel's own speed."""

SLOWEST_ROLLING = 8.0
"""Speed (m/s) below which slip builds up no more slowly: a car that stops must not rock on."""

# Slots of the results, four each: normal force, tyre force along the wheel's own longitudinal and
# lateral axis in the road plane, couple of the road about the wheel axis, force along the car's x
# and y, gap to the road, torque of the shaft, rates of spin and slip.
LOAD, LONGITUDINAL, LATERAL, COUPLE, FORWARD, LEFT, GAP, SHAFT, SPIN_RATE, SLIP_RATE = range(
    0, 40, 4
)
N_CONTACT = 40

SCRATCH = np.dtype(
    fields(
        "f8",
        "x y z dx dy dz axis_x axis_y axis_z turn_x turn_z longer slip_ratio inclination ahead "
        "aside aligning",
        4,
    )
)
"""Places of the hub from P's foot (z: from P) and of the contact from the hub, wheel axis, angular
velocity of the axle, slip ratio, sine of the inclination with camber, forces and moment of the
tyre."""
Scratch: TypeAlias = Any
_scratch, _scratch_of = stack_vector(SCRATCH.itemsize // 8), record_of(SCRATCH)


@inlined
def normal_force(stiffness: float, damping: float, deflection: float, lift: float) -> float:
    """Radial force (N) of a tyre deflected by that (m) while its radius grows by ``lift`` (m/s)."""
    force = max(stiffness * deflection - damping * lift, 0.0)
    return force if deflection > 0.0 else 0.0


@inlined
def _touch(  # noqa: PLR0917
    height: float,
    spins: Vector,
    slips: Vector,
    held: Vector,
    car: Car,
    motion: Motion,
    scratch: Scratch,
    contact: Vector,
) -> None:
    """Fill places and speeds, loads and slips; P is ``height`` (m) above the plane."""
    c, s = motion.cos_pitch, motion.sin_pitch
    ox, oy, oz = motion.rate[0], motion.rate[1], motion.rate[2]
    for wheel in range(4):
        c_tilt, s_tilt = of_axle(motion.cos, wheel), of_axle(motion.sin, wheel)
        wx = ox + of_axle(motion.tilt_rate, wheel)
        x, y, z = car.distance[wheel], motion.hub_y[wheel], motion.hub_z[wheel]
        vx, vy, vz = motion.hub_vx[wheel], motion.hub_vy[wheel], motion.hub_vz[wheel]
        ex, ez = -held[STEER_SIN + wheel], held[STEER_COS + wheel] * s_tilt
        ey = held[STEER_COS + wheel] * c_tilt
        # from the pitched to the heading frame
        x, z = c * x + s * z, c * z - s * x
        vx, vz = c * vx + s * vz, c * vz - s * vx
        ex, ez = c * ex + s * ez, c * ez - s * ex
        wx, wz = c * wx + s * oz, c * oz - s * wx
        # without the carrier's turn about the wheel axis, which the spin contains
        turned = wx * ex + oy * ey + wz * ez
        rx, ry, rz = wx - turned * ex, oy - turned * ey, wz - turned * ez
        steeper = 1.0 / (1.0 - ez * ez)
        longer = sqrt(steeper)
        above = height + z - held[ports.ROAD_HEIGHT + wheel]
        lean = above * ez * steeper
        dx, dy, dz = lean * ex, lean * ey, -above
        vx, vy, vz = vx + ry * dz - rz * dy, vy + rz * dx - rx * dz, vz + rx * dy - ry * dx

        compressed = car.unloaded_radius[wheel] - above * longer
        load = longer * normal_force(
            car.stiffness[wheel], car.damping[wheel], compressed, vz * longer
        )
        along, across = (vx * ey - vy * ex) * longer, (vx * ex + vy * ey) * longer
        reference = max(abs(along), SLOWEST)
        slip_speed = spins[wheel] * car.radius[wheel] - along
        scratch.slip_ratio[wheel] = slip_speed / reference
        rolling = max(abs(along), SLOWEST_ROLLING) * car.per_relaxation[wheel]
        contact[SLIP_RATE + wheel] = rolling * (-across / reference - slips[wheel])
        contact[LOAD + wheel], contact[GAP + wheel] = load, max(-compressed, 0.0)
        scratch.x[wheel], scratch.y[wheel], scratch.z[wheel] = x, y, z
        scratch.dx[wheel], scratch.dy[wheel], scratch.dz[wheel] = dx, dy, dz
        scratch.axis_x[wheel], scratch.axis_y[wheel], scratch.axis_z[wheel] = ex, ey, ez
        scratch.turn_x[wheel], scratch.turn_z[wheel] = wx, wz
        scratch.longer[wheel] = longer


@inlined
def _push(  # noqa: PLR0917
    spins: Vector,
    held: Vector,
    car: Car,
    motion: Motion,
    scratch: Scratch,
    forces: Forces,
    contact: Vector,
) -> None:
    """Add forces and moments on the axle, from the tyres and the spinning wheels."""
    c, s, oy = motion.cos_pitch, motion.sin_pitch, motion.rate[1]
    for wheel in range(4):
        radius, inertia = car.radius[wheel], car.spin_inertia[wheel]
        load, spin = contact[LOAD + wheel], spins[wheel]
        ahead, aside = scratch.ahead[wheel], scratch.aside[wheel]
        # no step at standstill
        towards = spin / max(abs(spin), 1.0)
        resistance = car.rolling_resistance[wheel] * load * towards
        torque = (held[DRIVE + wheel] - held[ports.BRAKE_FORCE + wheel] * towards) * radius
        rolled = (ahead + resistance) * radius
        ex, ey, ez = scratch.axis_x[wheel], scratch.axis_y[wheel], scratch.axis_z[wheel]
        dx, dy, dz = scratch.dx[wheel], scratch.dy[wheel], scratch.dz[wheel]
        x, y, z = scratch.x[wheel], scratch.y[wheel], scratch.z[wheel]
        wx, wz, longer = scratch.turn_x[wheel], scratch.turn_z[wheel], scratch.longer[wheel]
        fx, fy = (ahead * ey + aside * ex) * longer, (aside * ey - ahead * ex) * longer
        mx, my, mz = dy * load - dz * fy, dz * fx - dx * load, dx * fy - dy * fx
        mz += scratch.aligning[wheel]
        about = ex * mx + ey * my + ez * mz
        # the wheel turns freely but for the shaft's torque; as a gyrostat it resists
        free, spun = about + torque, inertia * spin
        mx += y * load - z * fy - free * ex - spun * (oy * ez - wz * ey)
        my += z * fx - x * load - free * ey - spun * (wz * ex - wx * ez)
        mz += x * fy - y * fx - free * ez - spun * (wx * ey - oy * ex)
        # from the heading to the pitched frame
        forces.force_x[wheel] += c * fx - s * load
        forces.force_y[wheel] += fy
        forces.force_z[wheel] += s * fx + c * load
        forces.moment_x[wheel] += c * mx - s * mz
        forces.moment_y[wheel] += my
        forces.moment_z[wheel] += s * mx + c * mz
        contact[LONGITUDINAL + wheel], contact[LATERAL + wheel] = ahead, aside
        contact[FORWARD + wheel], contact[LEFT + wheel] = fx, fy
        contact[COUPLE + wheel], contact[SHAFT + wheel] = -rolled - about, torque
        contact[SPIN_RATE + wheel] = (torque - rolled) / inertia


@inlined
def _inwards(wheel: int) -> float:
    """What makes a number that counts to the left count towards the middle of the car."""
    return 2.0 * (wheel % 2) - 1.0


@inlined
def _angle(kind: int, wheel: int, travels: Vector, car: Car, scratch: Scratch) -> float:
    """Toe or camber (rad) of a wheel under the forces so far, positive as a turn to the left."""
    inwards = _inwards(wheel)
    return inwards * curves.angle(
        car.axle[wheel // 2],
        car.points,
        kind,
        travels[wheel],
        inwards * scratch.aside[wheel],
        inwards * scratch.aligning[wheel],
    )


@inlined
def _given_way(car: Car, scratch: Scratch) -> float:
    """Turn (rad) of both front wheels to the left under the moments about their kingpins."""
    moments = scratch.aligning[0] + scratch.aligning[1]
    moments -= car.caster_trail * (scratch.aside[0] + scratch.aside[1])
    turn: float = car.steering_compliance * moments
    return turn


@inlined
def _steer(travels: Vector, held: Vector, car: Car, scratch: Scratch) -> None:
    """Turn the wheels by their toe and by what the steering gives way."""
    given_way = _given_way(car, scratch)
    for wheel in range(4):
        steer = held[STEERED + wheel] + _angle(curves.TOE, wheel, travels, car, scratch)
        if wheel < 2:
            steer += given_way
        held[STEER_COS + wheel], held[STEER_SIN + wheel] = cos(steer), sin(steer)


@inlined
def _incline(travels: Vector, held: Vector, car: Car, motion: Motion, scratch: Scratch) -> None:
    """Lean the wheels for their tyres by their camber."""
    for wheel in range(4):
        c, s = of_axle(motion.cos, wheel), of_axle(motion.sin, wheel)
        if car.axle[wheel // 2].rows[curves.CAMBER] > 0.0:
            c, s = motion.cos_roll, motion.sin_roll
        camber = _angle(curves.CAMBER, wheel, travels, car, scratch)
        up = (s * cos(camber) + c * sin(camber)) * held[STEER_COS + wheel]
        up = motion.cos_pitch * up + motion.sin_pitch * held[STEER_SIN + wheel]
        scratch.inclination[wheel] = up


@inlined
def _pull(  # noqa: PLR0917
    inclination: Vector, slips: Vector, held: Vector, car: Car, scratch: Scratch, contact: Vector
) -> None:
    """Fill the forces of the tyres, inclined by those sines."""
    for wheel in range(4):
        ahead, aside, aligning = tyre.forces(
            car.axle[wheel // 2],
            contact[LOAD + wheel],
            scratch.slip_ratio[wheel],
            slips[wheel],
            inclination[wheel],
            held[ports.FRICTION] + held[ports.WHEEL_FRICTION + wheel],
            1.0 - 2.0 * (wheel % 2),
        )
        scratch.ahead[wheel], scratch.aside[wheel] = ahead, aside
        scratch.aligning[wheel] = aligning


@inlined
def road_forces(  # noqa: PLR0917
    heave: float,
    travels: Vector,
    spins: Vector,
    slips: Vector,
    held: Vector,
    car: Car,
    motion: Motion,
    forces: Forces,
    contact: Vector,
) -> None:
    """Add the road's ``forces`` on both axles and fill the ``contact`` of the wheels."""
    scratch, height = _scratch_of(_scratch()), car.axis_height + heave
    if car.attitudes > 0.0:
        for wheel in range(4):
            scratch.aside[wheel], scratch.aligning[wheel] = 0.0, 0.0
        for _ in range(int(car.attitudes)):
            _steer(travels, held, car, scratch)
            _touch(height, spins, slips, held, car, motion, scratch, contact)
            _incline(travels, held, car, motion, scratch)
            _pull(scratch.inclination, slips, held, car, scratch, contact)
    else:
        _touch(height, spins, slips, held, car, motion, scratch, contact)
        _pull(scratch.axis_z, slips, held, car, scratch, contact)
    _push(spins, held, car, motion, scratch, forces, contact)
