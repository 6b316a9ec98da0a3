"""The preview driver and the open-loop steering robot: one kernel that fills a body's inputs.

The driver predicts the car's position one preview time ahead at its present motion, compares it
with the path, and demands the lateral acceleration that closes the gap in that time, a = 2 e / T².
To compensate for the car's lag it demands more as long as it feels less than that. It turns the
wheel by the bicycle model's steady gain, through the lag of the arms and the limits of the
steering, up to a maximum lateral acceleration.
"""

from math import cos, floor, hypot, sin
from typing import NamedTuple

from canroll.typing import Vector
from plant_sim.bodies import ports
from plant_sim.kernels.jit import borrowed, njit
from vehicles import GRAVITY

FOLLOW_PATH = 0
STEER_TABLE = 1
ACCELERATION_TABLE = 2
FISHHOOK = 3

(
    D_PREVIEW_TIME,
    D_LAG,
    D_ACCELERATION_LIMIT,
    D_WHEELBASE,
    D_UNDERSTEER,
    D_STEER_LIMIT,
    D_STEER_RATE,
    D_SPEED,
    D_SPEED_GAIN,
    D_RELEASE_TIME,
    D_PATH_STEP,
    D_TABLE_STEP,
    D_FRICTION,
    D_ROAD_STEP,
    D_FRONT,
    D_REAR,
    D_TIME_STEP,
    D_ANSWER_LAG,
    D_START,
    D_AMPLITUDE,
    D_HOLD,
    D_RETURN,
    D_CHASSIS_CONTROL,
    D_MASS,
    D_YAW_INERTIA,
    D_TRACK,
    D_CORNERING,
) = range(27)
N_DRIVER = 27

(M_STATION, M_STEER, M_TRAVELLED, M_PHASE, M_SINCE, M_YAW_REFERENCE) = range(6)
N_MEMORY = 6

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


class Drive(NamedTuple):
    """Inputs of a manoeuvre, as arrays for the kernels. ``memory`` belongs to one run only."""

    kind: int
    """FOLLOW_PATH, STEER_TABLE (road-wheel angle over time), ACCELERATION_TABLE or FISHHOOK."""
    parameters: Vector
    path_x: Vector
    """Path at equal steps of arc length (m)."""
    path_y: Vector
    table: Vector
    """Steering angle (rad) or lateral acceleration (m/s²) at equal steps of time."""
    bank: Vector
    """Road bank (rad) at equal steps of distance travelled."""
    road_left: Vector
    """Road height (m) under the left and the right wheels, at the same steps."""
    road_right: Vector
    memory: Vector


@njit
def uncounted(drive: Drive) -> Drive:
    """Views of the arrays of a drive that the caller keeps alive; see ``borrowed``."""
    return Drive(
        drive.kind,
        borrowed(drive.parameters),
        borrowed(drive.path_x),
        borrowed(drive.path_y),
        borrowed(drive.table),
        borrowed(drive.bank),
        borrowed(drive.road_left),
        borrowed(drive.road_right),
        borrowed(drive.memory),
    )


@njit
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


@njit
def _path_point(drive: Drive, station: float) -> tuple[float, float, float, float]:
    """Point and unit tangent of the path at ``station`` (m); straight on beyond its ends."""
    step = drive.parameters[D_PATH_STEP]
    last = drive.path_x.size - 2
    i = min(max(floor(station / step), 0), last)
    dx = drive.path_x[i + 1] - drive.path_x[i]
    dy = drive.path_y[i + 1] - drive.path_y[i]
    length = hypot(dx, dy)
    part = station / step - i
    return drive.path_x[i] + part * dx, drive.path_y[i] + part * dy, dx / length, dy / length


@njit
def off_path(drive: Drive, station: float, x: Vector, y: Vector, left: Vector) -> float:
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


@njit
def _follow(outputs: Vector, drive: Drive) -> float:
    """Road-wheel angle demanded by the driver (rad); updates station and path error."""
    parameters, memory = drive.parameters, drive.memory
    heading = outputs[ports.YAW]
    velocity_x = outputs[ports.VX] * cos(heading) - outputs[ports.VY] * sin(heading)
    velocity_y = outputs[ports.VX] * sin(heading) + outputs[ports.VY] * cos(heading)
    speed = max(hypot(velocity_x, velocity_y), 1.0)

    x, y, tx, ty = _path_point(drive, memory[M_STATION])
    away_x, away_y = outputs[ports.X] - x, outputs[ports.Y] - y
    memory[M_STATION] += min(max(away_x * tx + away_y * ty, 0.0), 1.0)
    outputs[ports.PATH_ERROR] = away_y * tx - away_x * ty

    preview = parameters[D_PREVIEW_TIME]
    target_x, target_y, _, _ = _path_point(drive, memory[M_STATION] + speed * preview)
    gap_x = target_x - outputs[ports.X] - velocity_x * preview
    gap_y = target_y - outputs[ports.Y] - velocity_y * preview
    lag = parameters[D_ANSWER_LAG]
    haste = 2.0 * lag * (preview - 0.5 * lag) / preview**2
    gap = (gap_y * velocity_x - gap_x * velocity_y) / speed
    limit = parameters[D_ACCELERATION_LIMIT]
    closing = 2.0 * gap / preview**2
    wanted = min(max((1.0 + haste) * closing - haste * outputs[ports.AY], -limit), limit)
    return float(wanted * (parameters[D_WHEELBASE] / speed**2 + parameters[D_UNDERSTEER]))


@njit
def _fishhook(time: float, outputs: Vector, drive: Drive) -> float:
    """Road-wheel angle of NHTSA's roll-rate feedback fishhook (rad).

    Steer to the amplitude, wait until the roll has built up, steer as far to the other side, hold,
    and return. ``memory`` keeps the phase and its start.
    """
    parameters, memory = drive.parameters, drive.memory
    amplitude = parameters[D_AMPLITUDE]
    if memory[M_PHASE] == 0.0 and time >= parameters[D_START]:
        memory[M_PHASE] = 1.0
    elif memory[M_PHASE] == 1.0 and abs(memory[M_STEER] - amplitude) < 1e-9:
        # The roll rate is far above the threshold here unless the car is already settling.
        if abs(outputs[ports.ROLL_RATE]) < REVERSAL_ROLL_RATE:
            memory[M_PHASE] = 2.0
    elif memory[M_PHASE] == 2.0 and abs(memory[M_STEER] + amplitude) < 1e-9:
        memory[M_PHASE], memory[M_SINCE] = 3.0, time
    if memory[M_PHASE] == 0.0:
        return 0.0
    if memory[M_PHASE] == 1.0:
        return float(amplitude)
    if memory[M_PHASE] == 2.0:
        return float(-amplitude)
    back = (time - memory[M_SINCE] - parameters[D_HOLD]) / parameters[D_RETURN]
    return float(-amplitude * min(max(1.0 - back, 0.0), 1.0))


@njit
def _stabilise(outputs: Vector, inputs: Vector, drive: Drive) -> None:
    """Unified chassis control: half by one front brake, half by extra steering.

    Demands the yaw moment that brings the yaw rate to the linear car's, limited to the lateral
    acceleration that the road permits; applied by the vehicle, independently of the roll law.
    """
    parameters, memory = drive.parameters, drive.memory
    speed = max(outputs[ports.VX], 3.0)
    wanted = inputs[ports.STEER] * speed
    wanted /= parameters[D_WHEELBASE] + parameters[D_UNDERSTEER] * speed**2
    most = 0.85 * GRAVITY * parameters[D_FRICTION] / speed
    wanted = min(max(wanted, -most), most)
    dt = parameters[D_TIME_STEP]
    memory[M_YAW_REFERENCE] += (wanted - memory[M_YAW_REFERENCE]) * dt / (YAW_REFERENCE_LAG + dt)
    error = memory[M_YAW_REFERENCE] - outputs[ports.YAW_RATE]
    error = max(error - YAW_DEAD_BAND, 0.0) + min(error + YAW_DEAD_BAND, 0.0)
    moment = YAW_GAIN * parameters[D_YAW_INERTIA] * error
    limit = 0.15 * parameters[D_MASS] * GRAVITY * parameters[D_FRICTION] * parameters[D_TRACK]
    brake = min(max(0.5 * moment, -limit), limit) / parameters[D_TRACK]
    for wheel in range(4):
        inputs[ports.BRAKE_FORCE + wheel] = 0.0
    if brake > 0.0:
        inputs[ports.BRAKE_FORCE] = brake
    else:
        inputs[ports.BRAKE_FORCE + 1] = -brake
    extra = 0.5 * moment / (parameters[D_CORNERING] * parameters[D_FRONT])
    inputs[ports.STEER] += min(max(extra, -EXTRA_STEER_LIMIT), EXTRA_STEER_LIMIT)


@njit
def drive(t_ns: int, outputs: Vector, inputs: Vector, drive: Drive) -> None:
    """Fill ``inputs`` for the step that starts at ``t_ns``, from the ``outputs`` of the last one.

    Writes steering, drive force, bank, friction, road heights or prescribed acceleration, and the
    path error into ``outputs``; leaves the actuator slots unchanged.
    """
    parameters, memory = drive.parameters, drive.memory
    time = t_ns * 1e-9
    dt = parameters[D_TIME_STEP]
    if drive.kind == ACCELERATION_TABLE:
        inputs[ports.LATERAL_ACCELERATION] = sample(drive.table, time / parameters[D_TABLE_STEP])
    else:
        if drive.kind == FOLLOW_PATH:
            wanted = _follow(outputs, drive)
            change = (wanted - memory[M_STEER]) * dt / (parameters[D_LAG] + dt)
        elif drive.kind == FISHHOOK:
            change = _fishhook(time, outputs, drive) - memory[M_STEER]
        else:
            change = sample(drive.table, time / parameters[D_TABLE_STEP]) - memory[M_STEER]
        most = parameters[D_STEER_RATE] * dt
        steer = memory[M_STEER] + min(max(change, -most), most)
        memory[M_STEER] = min(max(steer, -parameters[D_STEER_LIMIT]), parameters[D_STEER_LIMIT])
        inputs[ports.STEER] = memory[M_STEER]

    inputs[ports.FRICTION] = parameters[D_FRICTION]
    if parameters[D_CHASSIS_CONTROL] != 0.0:
        _stabilise(outputs, inputs, drive)
    if time < parameters[D_RELEASE_TIME]:
        inputs[ports.DRIVE_FORCE] = parameters[D_SPEED_GAIN] * (
            parameters[D_SPEED] - outputs[ports.VX]
        )
    else:
        inputs[ports.DRIVE_FORCE] = 0.0

    memory[M_TRAVELLED] += max(outputs[ports.VX], 0.0) * dt
    step = parameters[D_ROAD_STEP]
    travelled = memory[M_TRAVELLED]
    inputs[ports.BANK] = sample(drive.bank, travelled / step)
    if drive.road_left.size > 1:
        front = (travelled + parameters[D_FRONT]) / step
        rear = (travelled - parameters[D_REAR]) / step
        inputs[ports.ROAD_HEIGHT] = sample(drive.road_left, front)
        inputs[ports.ROAD_HEIGHT + 1] = sample(drive.road_right, front)
        inputs[ports.ROAD_HEIGHT + 2] = sample(drive.road_left, rear)
        inputs[ports.ROAD_HEIGHT + 3] = sample(drive.road_right, rear)
