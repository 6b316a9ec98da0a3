"""The preview driver and the open-loop steering robot: one kernel that fills a body's inputs.

The driver steers by the optimal preview control of :mod:`canroll.plant_sim.driving.preview`,
through the lag of the arms and the limits of the steering, up to the slip angle at which the front
tyres are near their peak.
"""

from math import cos, floor, hypot, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.driving.path import STEP as PATH_STEP
from canroll.plant_sim.driving.preview import POINTS, SPEED_STEP
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.kernels.jit import borrowed, inlined, njit
from canroll.plant_sim.kernels.records import fields
from canroll.typing import Vector
from canroll.vehicles import GRAVITY

TIME_STEP = STEP_NS * 1e-9

FOLLOW_PATH = 0
STEER_TABLE = 1
ACCELERATION_TABLE = 2
FISHHOOK = 3

DRIVER = np.dtype(
    fields(
        "f8",
        "preview_time lag slip_limit wheelbase understeer steer_limit steer_rate release_time "
        "table_step road_step friction front rear start amplitude hold back chassis_control mass "
        "yaw_inertia track cornering cg_height wind_factor wind_ahead wind_height",
    )
)
"""Driver, car and steps of a drive's tables; ``start`` to ``back`` are those of a fishhook."""
MEMORY = np.dtype(fields("f8", "station steer travelled phase since yaw_reference"))
"""What the driver keeps from step to step."""

STATES = 3
ROW = STATES + POINTS
"""Gains per speed in the table of preview gains: per state of the car, and per point."""

SPEED_LAG = 0.5
"""Lag (s) of the car's speed behind that which the driver wants: an error asks for the
acceleration that would remove it in that time."""

REVERSAL_ROLL_RATE = 0.0262
"""Roll rate (rad/s, 1.5 degrees/s) below which the fishhook's countersteer begins (NHTSA)."""

YAW_REFERENCE_LAG = 0.1
"""Lag of the chassis control's yaw reference behind the linear car's steady yaw rate (s)."""

YAW_GAIN = 6.0
"""Yaw acceleration demanded by the chassis control per yaw-rate error (1/s)."""

YAW_DEAD_BAND = 0.02
"""Dead band of the chassis control in yaw-rate error (rad/s)."""

EXTRA_STEER_LIMIT = 0.035
"""Angle (rad) that the chassis control may add to the driver's steering."""


class DriveInputs(NamedTuple):
    """Inputs of a manoeuvre, as arrays for the kernels. ``memory`` belongs to one run only."""

    kind: int
    """FOLLOW_PATH, STEER_TABLE (road-wheel angle over time), ACCELERATION_TABLE or FISHHOOK."""
    parameters: NDArray[Any]
    """One :data:`DRIVER`."""
    path_x: Vector
    """Path at equal steps of arc length (m)."""
    path_y: Vector
    table: Vector
    """Steering angle (rad) or lateral acceleration (m/s²) at equal steps of time."""
    speed: Vector
    """Speed to be driven (m/s), one value per step of the plant; one alone is constant."""
    bank: Vector
    """Road bank (rad) at equal steps of distance travelled."""
    road_left: Vector
    """Road height (m) under the left and the right wheels, at the same steps."""
    road_right: Vector
    grade: Vector
    """Road grade (rad), at the same steps."""
    friction_left: Vector
    """Road friction under the left and the right wheels, at the same steps; one alone: 1."""
    friction_right: Vector
    wind: Vector
    """Wind along the world's y axis (m/s), at the same steps; one alone: none."""
    pedal: Vector
    """Acceleration that the pedals ask for (m/s²), one value per step since the accelerator was
    released; one alone: 0."""
    preview: Vector
    """Preview gains over speed, see :func:`canroll.plant_sim.driving.preview.table`."""
    memory: NDArray[Any]
    """One :data:`MEMORY`."""


OVER_DISTANCE = (
    *("bank", "grade", "road_left", "road_right"),
    *("friction_left", "friction_right", "wind"),
)
"""Fields of a drive at steps of distance."""


@njit
def uncounted(drive: DriveInputs) -> DriveInputs:
    """Views of the arrays of a drive that the caller keeps alive; see ``borrowed``."""
    return DriveInputs(
        drive.kind,
        borrowed(drive.parameters),
        borrowed(drive.path_x),
        borrowed(drive.path_y),
        borrowed(drive.table),
        borrowed(drive.speed),
        borrowed(drive.bank),
        borrowed(drive.road_left),
        borrowed(drive.road_right),
        borrowed(drive.grade),
        borrowed(drive.friction_left),
        borrowed(drive.friction_right),
        borrowed(drive.wind),
        borrowed(drive.pedal),
        borrowed(drive.preview),
        borrowed(drive.memory),
    )


@inlined
def sample(table: Vector, position: float) -> float:
    """Linear interpolation in ``table`` at ``position`` (in steps), held at its ends."""
    last = table.size - 1
    if position <= 0.0:
        return float(table[0])
    if position >= last:
        return float(table[last])
    i = floor(position)
    part = position - i
    return float(table[i] * (1.0 - part) + table[i + 1] * part)


@inlined
def _segment(drive: DriveInputs, station: float) -> tuple[int, float]:
    """Segment of the path at ``station`` (m), and the share of it that lies before."""
    place = station / PATH_STEP
    i = min(max(floor(place), 0), drive.path_x.size - 2)
    return i, place - i


@inlined
def _path_point(drive: DriveInputs, station: float) -> tuple[float, float, float, float]:
    """Point and unit tangent of the path at ``station`` (m); straight on beyond its ends."""
    i, part = _segment(drive, station)
    dx = drive.path_x[i + 1] - drive.path_x[i]
    dy = drive.path_y[i + 1] - drive.path_y[i]
    length = hypot(dx, dy)
    return drive.path_x[i] + part * dx, drive.path_y[i] + part * dy, dx / length, dy / length


@njit
def off_path(drive: DriveInputs, station: float, x: Vector, y: Vector, left: Vector) -> float:
    """Fill ``left`` with the distance left of the path (m) at each of the points ``x``, ``y`` (m).

    The station (m) advances from point to point like the driver's, at most 1 m per point, so that
    a path that crosses itself is followed in order. Returns that after the last point.
    """
    for i in range(x.size):
        path_x, path_y, tx, ty = _path_point(drive, station)
        away_x, away_y = x[i] - path_x, y[i] - path_y
        station += min(max(away_x * tx + away_y * ty, 0.0), 1.0)
        left[i] = away_y * tx - away_x * ty
    return station


@inlined
def _follow(outputs: Vector, drive: DriveInputs) -> float:
    """Road-wheel angle demanded by the driver (rad); updates station and path error."""
    memory = drive.memory[0]
    speed = max(hypot(outputs[ports.VX], outputs[ports.VY]), 1.0)
    x, y, tx, ty = _path_point(drive, memory.station)
    away_x, away_y = outputs[ports.X] - x, outputs[ports.Y] - y
    memory.station += min(max(away_x * tx + away_y * ty, 0.0), 1.0)
    outputs[ports.PATH_ERROR] = away_y * tx - away_x * ty
    return _previewed(outputs, drive, speed)


@inlined
def _gain(table: Vector, at: int, part: float) -> float:
    """Preview gain at the place ``at`` of one speed, that ``part`` of a step above it."""
    return float(table[at] * (1.0 - part) + table[at + ROW] * part)


@inlined
def _previewed(outputs: Vector, drive: DriveInputs, speed: float) -> float:
    """Demand of the preview control (rad), up to the slip angle that the driver allows."""
    parameters, memory, table = drive.parameters[0], drive.memory[0], drive.preview
    # the table's ends hold beyond them
    last = table.size // ROW - 1
    held = min(max(speed / SPEED_STEP - 1.0, 0.0), float(last))
    row = min(floor(held), last - 1)
    at, part = row * ROW, held - row
    wanted = -outputs[ports.VY] * _gain(table, at, part)
    wanted -= outputs[ports.YAW_RATE] * _gain(table, at + 1, part)
    wanted -= memory.steer * _gain(table, at + 2, part)
    cosine, sine = cos(outputs[ports.YAW]), sin(outputs[ports.YAW])
    apart = speed * parameters.preview_time / POINTS
    for k in range(POINTS):
        i, along = _segment(drive, memory.station + apart * (k + 1))
        x = drive.path_x[i] + along * (drive.path_x[i + 1] - drive.path_x[i])
        y = drive.path_y[i] + along * (drive.path_y[i + 1] - drive.path_y[i])
        offset = (y - outputs[ports.Y]) * cosine - (x - outputs[ports.X]) * sine
        wanted += offset * _gain(table, at + STATES + k, part)
    across = outputs[ports.VY] + parameters.front * outputs[ports.YAW_RATE]
    straight = across / max(outputs[ports.VX], 1.0)
    limit = parameters.slip_limit
    return float(min(max(wanted, straight - limit), straight + limit))


@njit
def _fishhook(time: float, outputs: Vector, drive: DriveInputs) -> float:
    """Road-wheel angle of NHTSA's roll-rate feedback fishhook (rad).

    Steer to the amplitude, wait until the roll has built up, steer as far to the other side, hold,
    and return. ``memory`` keeps the phase and its start.
    """
    parameters, memory = drive.parameters[0], drive.memory[0]
    amplitude = parameters.amplitude
    if memory.phase == 0.0 and time >= parameters.start:
        memory.phase = 1.0
    elif memory.phase == 1.0 and abs(memory.steer - amplitude) < 1e-9:
        # The roll rate is far above the threshold here unless the car is already settling.
        if abs(outputs[ports.ROLL_RATE]) < REVERSAL_ROLL_RATE:
            memory.phase = 2.0
    elif memory.phase == 2.0 and abs(memory.steer + amplitude) < 1e-9:
        memory.phase, memory.since = 3.0, time
    if memory.phase == 0.0:
        return 0.0
    if memory.phase == 1.0:
        return float(amplitude)
    if memory.phase == 2.0:
        return float(-amplitude)
    back = (time - memory.since - parameters.hold) / parameters.back
    return float(-amplitude * min(max(1.0 - back, 0.0), 1.0))


@njit
def _stabilise(outputs: Vector, inputs: Vector, drive: DriveInputs) -> None:
    """Unified chassis control: half by one front brake, half by extra steering.

    Demands the yaw moment that brings the yaw rate to the linear car's, limited to the lateral
    acceleration that the road permits; applied by the vehicle, independently of the roll law.
    """
    parameters, memory = drive.parameters[0], drive.memory[0]
    speed = max(outputs[ports.VX], 3.0)
    wanted = inputs[ports.STEER] * speed
    wanted /= parameters.wheelbase + parameters.understeer * speed**2
    most = 0.85 * GRAVITY * parameters.friction / speed
    wanted = min(max(wanted, -most), most)
    dt = TIME_STEP
    memory.yaw_reference += (wanted - memory.yaw_reference) * dt / (YAW_REFERENCE_LAG + dt)
    error = memory.yaw_reference - outputs[ports.YAW_RATE]
    error = max(error - YAW_DEAD_BAND, 0.0) + min(error + YAW_DEAD_BAND, 0.0)
    moment = YAW_GAIN * parameters.yaw_inertia * error
    limit = 0.15 * parameters.mass * GRAVITY * parameters.friction * parameters.track
    brake = min(max(0.5 * moment, -limit), limit) / parameters.track
    for wheel in range(4):
        inputs[ports.BRAKE_FORCE + wheel] = 0.0
    if brake > 0.0:
        inputs[ports.BRAKE_FORCE] = brake
    else:
        inputs[ports.BRAKE_FORCE + 1] = -brake
    extra = 0.5 * moment / (parameters.cornering * parameters.front)
    inputs[ports.STEER] += min(max(extra, -EXTRA_STEER_LIMIT), EXTRA_STEER_LIMIT)


@njit
def _press(time: float, inputs: Vector, drive: DriveInputs) -> None:
    """Fill drive and brake forces of the pedals, the brakes' by the axles' loads at that braking.

    Brakes of the chassis control are added to those of the pedal.
    """
    parameters = drive.parameters[0]
    since = (time - parameters.release_time) / TIME_STEP
    wanted = parameters.mass * sample(drive.pedal, since)
    inputs[ports.DRIVE_FORCE] = max(wanted, 0.0)
    braked = max(-wanted, 0.0)
    moved = parameters.cg_height * braked / (parameters.mass * GRAVITY)
    front = (parameters.rear + moved) / parameters.wheelbase
    for wheel in range(4):
        share = front if wheel < 2 else 1.0 - front
        own = inputs[ports.BRAKE_FORCE + wheel] if parameters.chassis_control != 0.0 else 0.0
        inputs[ports.BRAKE_FORCE + wheel] = own + 0.5 * share * braked


@njit
def _grip(front: float, rear: float, inputs: Vector, drive: DriveInputs) -> None:
    """Fill the friction under the wheels of both axles, at those steps of distance."""
    inputs[ports.WHEEL_FRICTION] = sample(drive.friction_left, front)
    inputs[ports.WHEEL_FRICTION + 1] = sample(drive.friction_right, front)
    inputs[ports.WHEEL_FRICTION + 2] = sample(drive.friction_left, rear)
    inputs[ports.WHEEL_FRICTION + 3] = sample(drive.friction_right, rear)
    mean = 0.0
    for wheel in range(4):
        inputs[ports.WHEEL_FRICTION + wheel] *= drive.parameters[0].friction
        mean += 0.25 * inputs[ports.WHEEL_FRICTION + wheel]
    inputs[ports.FRICTION] = mean
    for wheel in range(4):
        inputs[ports.WHEEL_FRICTION + wheel] -= mean


@njit
def _blow(wind: float, outputs: Vector, inputs: Vector, parameters: Any) -> None:  # noqa: ANN401
    """Fill the force of a ``wind`` (m/s) along the world's y axis: see ``Aerodynamics``."""
    along = wind * sin(outputs[ports.YAW]) - outputs[ports.VX]
    across = wind * cos(outputs[ports.YAW]) - outputs[ports.VY]
    force = parameters.wind_factor * hypot(along, across) * across
    inputs[ports.WIND_FORCE] = force
    inputs[ports.WIND_ROLL] = -parameters.wind_height * force
    inputs[ports.WIND_YAW] = parameters.wind_ahead * force


@inlined
def drive(t_ns: int, outputs: Vector, inputs: Vector, drive: DriveInputs) -> None:
    """Fill ``inputs`` for the step that starts at ``t_ns``, from the ``outputs`` of the last one.

    Writes steering, drive force, bank, friction, road heights, wind or prescribed acceleration, and
    the path error into ``outputs``; leaves the actuator slots unchanged.
    """
    parameters, memory = drive.parameters[0], drive.memory[0]
    time = t_ns * 1e-9
    dt = TIME_STEP
    if drive.kind == ACCELERATION_TABLE:
        inputs[ports.LATERAL_ACCELERATION] = sample(drive.table, time / parameters.table_step)
    else:
        if drive.kind == FOLLOW_PATH:
            wanted = _follow(outputs, drive)
            change = (wanted - memory.steer) * dt / (parameters.lag + dt)
        elif drive.kind == FISHHOOK:
            change = _fishhook(time, outputs, drive) - memory.steer
        else:
            change = sample(drive.table, time / parameters.table_step) - memory.steer
        most = parameters.steer_rate * dt
        steer = memory.steer + min(max(change, -most), most)
        memory.steer = min(max(steer, -parameters.steer_limit), parameters.steer_limit)
        inputs[ports.STEER] = memory.steer

    inputs[ports.FRICTION] = parameters.friction
    if parameters.chassis_control != 0.0:
        _stabilise(outputs, inputs, drive)
    if time < parameters.release_time:
        # The speed and what it changes by in one lag, by which the car is behind: a ramp is then
        # followed without lag. The change is that about this instant, so that corners stay.
        ahead = sample(drive.speed, time / dt)
        ahead += sample(drive.speed, (time + 0.5 * SPEED_LAG) / dt)
        ahead -= sample(drive.speed, (time - 0.5 * SPEED_LAG) / dt)
        inputs[ports.DRIVE_FORCE] = parameters.mass / SPEED_LAG * (ahead - outputs[ports.VX])
    elif drive.pedal.size > 1:
        _press(time, inputs, drive)
    else:
        inputs[ports.DRIVE_FORCE] = 0.0

    memory.travelled += max(outputs[ports.VX], 0.0) * dt
    step = parameters.road_step
    travelled = memory.travelled
    inputs[ports.BANK] = sample(drive.bank, travelled / step)
    inputs[ports.GRADE] = sample(drive.grade, travelled / step)
    front = (travelled + parameters.front) / step
    rear = (travelled - parameters.rear) / step
    if drive.friction_left.size > 1:
        _grip(front, rear, inputs, drive)
    if drive.wind.size > 1:
        _blow(sample(drive.wind, travelled / step), outputs, inputs, parameters)
    if drive.road_left.size > 1:
        inputs[ports.ROAD_HEIGHT] = sample(drive.road_left, front)
        inputs[ports.ROAD_HEIGHT + 1] = sample(drive.road_right, front)
        inputs[ports.ROAD_HEIGHT + 2] = sample(drive.road_left, rear)
        inputs[ports.ROAD_HEIGHT + 3] = sample(drive.road_right, rear)
