"""The 14-DOF plant driven with measured steering, speed and moments: no bus, no ECU."""

from collections.abc import Mapping
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.extensions.car.identification.drive_log import DELIVERED
from canroll.extensions.car.identification.pieces import SAMPLE, Piece
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.ports import WHEELS, initial_inputs
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.nodes.imu_motion import (
    FORCE,
    N_MOTION,
    RATE,
    along,
    mounting,
    specific_motion,
)
from canroll.typing import Vector
from canroll.vehicles import Vehicle

ROW = 0.002
"""Interval of recorded rows (s): signals are delayed by interpolation between them."""
FASTEST = 1.25
"""Most that a step turns the spin of a wheel towards the car's speed, at the load of rest.

Twice as much on a wheel with twice the load; the Runge-Kutta step of fourth order permits 2.78.
"""
SPEED_GAIN = 20.0
"""Traction per mass and error in speed (1/s): follows 3.5 m/s² within 0.2 m/s."""

# Columns of a record: as an inertial unit on the body gives them, levelled, and the rest.
BODY_YAW, BODY_AY, BODY_ROLL, YAW, AY, ROLL_RATE, ROLL, SIDESLIP, ROLLOVER, TRAVEL = range(10)
N_COLUMNS = TRAVEL + 4

_REST = {
    "roll": ROLL,
    "sideslip": SIDESLIP,
    **{f"travel_{wheel}": TRAVEL + k for k, wheel in enumerate(WHEELS)},
}
FRAMES: Mapping[str, Mapping[str, int]] = {
    "body": {"yaw_rate": BODY_YAW, "lateral_acceleration": BODY_AY, "roll_rate": BODY_ROLL} | _REST,
    "levelled": {"yaw_rate": YAW, "lateral_acceleration": AY, "roll_rate": ROLL_RATE} | _REST,
}
"""Column of each signal by the axes of the inertial unit.

"body": rates about and specific force along its own axes, which are out of line with the body's by
``sensors.imu_misalignment``, with gravity's share in a roll.
"levelled": rates of the Euler angles and horizontal acceleration, as navigation units give them.
"""


class _Run(NamedTuple):
    state: Vector
    inputs: Vector
    parameters: Vector
    outputs: Vector
    steer: Vector
    speed: Vector
    moments: NDArray[np.float64]
    arm: Vector
    mounting: Vector
    record: NDArray[np.float64]


@njit
def _drive_through(step: Any, run: _Run, mass: float, dt: float) -> None:  # noqa: ANN401
    """Fill the record; inputs are those in the middle of each step of ``dt`` (s)."""
    motion, steps = np.zeros(N_MOTION), len(run.steer) // len(run.record)
    step(run.state, run.inputs, run.parameters, run.outputs, 0.0)
    for k in range(len(run.steer)):
        if k % steps == 0:
            specific_motion(run.inputs, run.outputs, run.arm, motion)
            roll = run.outputs[ports.ROLL]
            row = run.record[k // steps]
            row[BODY_YAW] = along(run.mounting, 2, motion, RATE)
            row[BODY_ROLL] = along(run.mounting, 0, motion, RATE)
            row[BODY_AY] = along(run.mounting, 1, motion, FORCE)
            row[AY] = np.cos(roll) * motion[FORCE + 1] - np.sin(roll) * motion[FORCE + 2]
            row[YAW], row[ROLL_RATE] = run.outputs[ports.YAW_RATE], run.outputs[ports.ROLL_RATE]
            row[ROLL] = roll
            row[SIDESLIP] = np.arctan2(run.outputs[ports.VY], run.outputs[ports.VX])
            row[ROLLOVER] = run.outputs[ports.ROLLOVER]
            for wheel in range(4):
                row[TRAVEL + wheel] = run.outputs[ports.TRAVEL + wheel]
        run.inputs[ports.STEER] = run.steer[k]
        for axle in range(2):
            run.inputs[ports.BAR_MOMENT_FRONT + axle] = run.moments[axle, k]
        run.inputs[ports.DRIVE_FORCE] = SPEED_GAIN * mass * (run.speed[k] - run.outputs[ports.VX])
        step(run.state, run.inputs, run.parameters, run.outputs, dt)


def _step(vehicle: Vehicle, slowest: float) -> float:
    """Return the step (s), a part of a row, at which the wheels' spin is stable."""
    tyre = vehicle.tyre
    rate = tyre.longitudinal_stiffness * tyre.radius**2 / (tyre.wheel_inertia * slowest)
    return ROW / ceil(rate * ROW / FASTEST)


def motion(vehicle: Vehicle, piece: Piece, steering_offset: float) -> NDArray[np.float64]:
    """Drive the plant through a piece of a log, from straight running.

    Args:
        vehicle: the car; ``sensors`` says where its inertial unit sits and how it is turned.
        piece: what was steered, how fast, and with what moments.
        steering_offset: of the measured steering-wheel angle (rad), subtracted.

    Returns:
        a row every :data:`ROW` from the piece's begin on, (k, :data:`N_COLUMNS`).

    Raises:
        CanrollError: no plant can have these numbers.
    """
    body = bodies.body("nonlinear")
    rows, dt = round(len(piece.speed) * SAMPLE / ROW), _step(vehicle, float(piece.speed.min()))
    steps, known = rows * round(ROW / dt), SAMPLE * np.arange(len(piece.speed))
    at = dt * (np.arange(steps) + 0.5)
    steer = (np.interp(at, known, piece.steering) - steering_offset) / vehicle.steering.ratio
    speed = np.interp(at, known, piece.speed)
    moments = np.zeros((len(DELIVERED), steps))
    for axle, name in enumerate(DELIVERED):
        if name in piece.moments:
            moments[axle] = np.interp(at, known, piece.moments[name])
    state, parameters = body.build(vehicle, float(speed[0]))
    record = np.empty((rows, N_COLUMNS))
    arm, outputs = np.array(vehicle.sensors.imu_position), np.zeros(ports.N_OUTPUTS)
    turn, inputs = mounting(vehicle.sensors.imu_misalignment).ravel(), initial_inputs()
    run = _Run(state, inputs, parameters, outputs, steer, speed, moments, arm, turn, record)
    _drive_through(body.step, run, vehicle.total_mass, dt)
    return record


def sampled(record: NDArray[np.float64], column: int, piece: Piece, delay: float) -> Vector:
    """Return a column at the samples of a piece, ``delay`` (s) later than it happens."""
    at = SAMPLE * np.arange(len(piece.speed)) - delay
    return np.asarray(np.interp(at, ROW * np.arange(len(record)), record[:, column]))
