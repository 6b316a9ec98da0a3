"""Slots of the two float64 vectors that every plant body shares: ``inputs`` and ``outputs``.

Axes: x forward, y left, z up; roll > 0 lifts the left side; bank > 0 is a road whose left side is
higher; wheels in the order front left, front right, rear left, rear right. SI units throughout.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, NamedTuple

import numpy as np

from canroll.errors import CanrollError
from canroll.extension import guarded
from canroll.plant_sim.kernels.jit import STEP_SIGNATURE
from canroll.typing import Vector
from canroll.vehicles import Vehicle

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")

# What drives a body. A slot for four wheels names the first of four consecutive ones.
STEER = 0  # steering-wheel angle over the ratio on centre, > 0 left (rad): of the road wheels
# without a table of the steering
DRIVE_FORCE = 1  # sum of traction at the driven wheels, < 0 brakes evenly (N)
BRAKE_FORCE = 2  # braking force demanded at each wheel, >= 0 (N), 4
CORNER_FORCE = 6  # actuator force on the body at each corner, upwards, reaction on the wheel (N), 4
BAR_MOMENT_FRONT = 10  # moment on the body, > 0 lifts the left side, reaction on the wheels (N·m)
BAR_MOMENT_REAR = 11
VALVE_CURRENT_FRONT = 12  # servo-valve current of the electro-hydraulic bars (A)
VALVE_CURRENT_REAR = 13
ROAD_HEIGHT = 14  # road height under each wheel (m), 4
BANK = 18  # road bank angle (rad)
GRADE = 19  # road grade, > 0 uphill (rad)
FRICTION = 20  # road friction, scales the tyre's peak
LATERAL_ACCELERATION = 21  # prescribed a_y (m/s²) for the roll-only plant; NaN: from the tyres
WHEEL_FRICTION = 22  # road friction under each wheel above FRICTION, 4
WIND_FORCE = 26  # side force of the air on the body, along the car's left (N)
WIND_ROLL = 27  # its moment about the road's x axis under the CG, > 0 lifts the left side (N·m)
WIND_YAW = 28  # its moment about the vertical axis through the CG, > 0 turns left (N·m)
N_INPUTS = 29

# Outputs of a body. The heading frame lies in the road plane, x along the heading, z its normal.
X = 0  # position on the road plane of the point under the static CG of the whole car (m)
Y = 1
YAW = 2  # heading (rad)
VX = 3  # velocity of that point in the heading frame (m/s)
VY = 4
AX = 5  # inertial acceleration of the whole car's CG in the heading frame (m/s²)
AY = 6
YAW_RATE = 7
YAW_ACC = 8
ROLL = 9  # of the body relative to the road (rad)
ROLL_RATE = 10
ROLL_ACC = 11
PITCH = 12  # > 0 nose down (rad)
PITCH_RATE = 13
PITCH_ACC = 14
HEAVE = 15  # of the sprung CG from its static height (m)
HEAVE_RATE = 16
HEAVE_ACC = 17
WHEEL_LOAD = 18  # vertical tyre load (N), 4
TRAVEL = 22  # suspension travel from static, extension > 0 (m), 4
TRAVEL_RATE = 26  # (m/s), 4
WHEEL_SPEED = 30  # spin (rad/s), 4
WHEEL_HEIGHT = 34  # gap between each tyre and the road (m), 4
LATERAL_FORCE = 38  # tyre force of each wheel along the car's left (N), 4
PATH_ERROR = 42  # lateral distance from the driver's path, left > 0 (m); the driver fills it
ROLLOVER = 43  # 1 once the car has rolled over: an end state
TWO_WHEEL_LIFT = 44  # 1 while both wheels of one side are off the road
BAR_MOMENT = 45  # moment on the body from integrated electro-hydraulic bars (N·m), 2
BAR_ANGLE = 47  # shaft angle of their hydromotors (rad), 2
BAR_PRESSURE = 49  # their load pressure (Pa), 2
BODY_ACC = 51  # inertial acceleration of the sprung CG in the heading frame (m/s²), 3
N_OUTPUTS = 54

AXLES = ("front", "rear")


class Port(NamedTuple):
    """A quantity of a body by name: first slot, unit, and one, one an axle (2) or a wheel (4).

    ``recorded``: it is a signal of a run; ``exchanged``: a quantity that an FMU may have.
    """

    name: str
    slot: int
    unit: str = ""
    number: int = 1
    recorded: bool = True
    exchanged: bool = True

    @property
    def slots(self) -> dict[str, int]:
        """Slot by name; one an axle or a wheel has its place as a suffix."""
        places = {1: ("",), 2: AXLES, 4: WHEELS}[self.number]
        return {f"{self.name}_{place}".rstrip("_"): self.slot + k for k, place in enumerate(places)}


INPUTS = (
    Port("steer", STEER, "rad"),
    Port("drive_force", DRIVE_FORCE, "N", recorded=False),
    Port("brake_force", BRAKE_FORCE, "N", 4, recorded=False),
    Port("corner_force", CORNER_FORCE, "N", 4),
    Port("bar_moment", BAR_MOMENT_FRONT, "N·m", 2),
    Port("valve_current", VALVE_CURRENT_FRONT, "A", 2),
    Port("road_height", ROAD_HEIGHT, "m", 4, recorded=False),
    Port("bank", BANK, "rad"),
    Port("grade", GRADE, "rad", recorded=False),
    Port("friction", FRICTION),
    Port("wheel_friction", WHEEL_FRICTION, number=4),
    Port("wind_force", WIND_FORCE, "N"),
    Port("wind_roll", WIND_ROLL, "N·m", recorded=False),
    Port("wind_yaw", WIND_YAW, "N·m", recorded=False),
)
"""What drives a body."""
OUTPUTS = (
    *(Port("x", X, "m"), Port("y", Y, "m"), Port("yaw", YAW, "rad")),
    *(Port("vx", VX, "m/s"), Port("vy", VY, "m/s"), Port("ax", AX, "m/s²"), Port("ay", AY, "m/s²")),
    *(Port("yaw_rate", YAW_RATE, "rad/s"), Port("yaw_acc", YAW_ACC, "rad/s²")),
    Port("roll", ROLL, "rad"),
    *(Port("roll_rate", ROLL_RATE, "rad/s"), Port("roll_acc", ROLL_ACC, "rad/s²")),
    Port("pitch", PITCH, "rad"),
    *(Port("pitch_rate", PITCH_RATE, "rad/s"), Port("pitch_acc", PITCH_ACC, "rad/s²")),
    Port("heave", HEAVE, "m"),
    *(Port("heave_rate", HEAVE_RATE, "m/s"), Port("heave_acc", HEAVE_ACC, "m/s²")),
    *(
        Port(f"sprung_a{axis}", BODY_ACC + k, "m/s²", recorded=axis == "y")
        for k, axis in enumerate("xyz")
    ),
    Port("wheel_load", WHEEL_LOAD, "N", 4),
    *(Port("travel", TRAVEL, "m", 4), Port("travel_rate", TRAVEL_RATE, "m/s", 4)),
    Port("wheel_speed", WHEEL_SPEED, "rad/s", 4),
    Port("wheel_height", WHEEL_HEIGHT, "m", 4),
    Port("lateral_force", LATERAL_FORCE, "N", 4),
    Port("path_error", PATH_ERROR, "m", exchanged=False),
    *(Port("rollover", ROLLOVER), Port("two_wheel_lift", TWO_WHEEL_LIFT)),
    Port("bar_angle", BAR_ANGLE, "rad", 2, exchanged=False),
    Port("bar_pressure", BAR_PRESSURE, "Pa", 2, exchanged=False),
)
"""What a body does; the moments of integrated bars are those of the actuators in a record."""

ROLLOVER_ANGLE = 0.6
"""Roll angle (rad) beyond which no car comes back: an end state of every body."""

STATES_MAX, PARAMETERS_MAX = 64, 4096
"""Room for a body's state and parameters."""


@dataclass(frozen=True, slots=True)
class Outside:
    """What a body has that runs in another process.

    Both are called with the parameters that ``build`` has given: ``check`` after the steps, to
    raise what went wrong in them, ``close`` at the end.
    """

    check: Callable[[Vector], None]
    close: Callable[[Vector], None]


@dataclass(frozen=True, slots=True)
class Body:
    """One plant body.

    ``step(state, inputs, parameters, outputs, dt)`` is a numba C function: it advances ``state``
    in place and fills ``outputs``. ``build(vehicle, speed)`` gives the state on a straight road
    at ``speed`` (m/s) and the parameter vector. ``lacks`` are outputs that it does not have: pitch
    and heave are 0 then, all others NaN. ``friction``: whether the road's friction limits it,
    ``wind`` whether the wind moves it, ``constant_speed`` whether it keeps its entry speed
    whatever the drive force.
    """

    name: str
    step: Any
    build: Callable[[Vehicle, float], tuple[Vector, Vector]]
    outside: Outside | None = None
    lacks: tuple[str, ...] = ()
    friction: bool = True
    wind: bool = True
    constant_speed: bool = False

    def left_out(self, vehicle: Vehicle) -> Iterator[str]:
        """What the vehicle's file has and this body lacks, one line each."""
        linear = not self.friction and self.outside is None
        if not linear or vehicle.axles is None:
            return
        front = vehicle.axles.front
        lost = {
            "toe and camber of its tables have": vehicle.axles.has_attitudes,
            "the table of its steering, beyond the ratio on centre, has": front.steering,
            "what its steering gives way has": front.steering_system,
        }
        for what, given in lost.items():
            if given:
                yield f"{vehicle.name}: {what} no effect on {self.name}: use --plant nonlinear"


def initial_inputs() -> Vector:
    """Inputs of a car on a flat, dry road without steering, drive or actuation."""
    inputs = np.zeros(N_INPUTS)
    inputs[FRICTION] = 1.0
    inputs[LATERAL_ACCELERATION] = np.nan
    return inputs


def accept(what: str, body: object) -> Body:
    """Wrap an extension's body so that its results are checked.

    Args:
        what: kind of object, for error messages.
        body: the body.

    Raises:
        CanrollError: not a body, its step is not a C function of the right signature, or its build
            cannot be called with a vehicle and a speed.
    """
    if not isinstance(body, Body):
        raise CanrollError(f"{what}: a {type(body).__name__}, it must be a Body")
    if getattr(body.step, "_sig", None) != STEP_SIGNATURE:
        raise CanrollError(
            f"{what}: its step must be compiled with "
            "canroll.plant_sim.kernels.jit.cfunc(STEP_SIGNATURE)"
        )
    build = guarded(what, body.build, 2, tuple)

    @wraps(body.build)
    def checked(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
        built = build(vehicle, speed)
        if len(built) != 2:
            raise CanrollError(f"{what}: build returns {len(built)} values, it must be 2")
        for name, values, room in zip(
            ("state", "parameters"), built, (STATES_MAX, PARAMETERS_MAX), strict=True
        ):
            if not isinstance(values, np.ndarray) or values.dtype != float or values.ndim != 1:
                raise CanrollError(f"{what}: its {name} must be a float64 array of one dimension")
            if len(values) > room:
                raise CanrollError(f"{what}: {len(values)} values of {name}, at most {room}")
            if not np.isfinite(values).all():
                raise CanrollError(f"{what}: its {name} is not finite")
        return built

    return replace(body, build=checked)
