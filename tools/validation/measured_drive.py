"""A measured drive on a uniform time base, and its replay through a plant body."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.documents import text
from canroll.errors import CanrollError, reason
from canroll.typing import Vector
from plant_sim import bodies
from plant_sim.bodies import ports
from plant_sim.bodies.ports import initial_inputs
from plant_sim.kernels.jit import njit
from plant_sim.nodes.imu_motion import FORCE, GRAVITY, N_MOTION, specific_motion
from vehicles import Vehicle

SAMPLE, STEP = 0.01, 0.001
"""Interval of the measurements and step of the plant (s)."""

PER_SAMPLE = round(SAMPLE / STEP)
SPEED_GAIN = 20.0
"""Traction per mass and error in speed (1/s): follows 3.5 m/s² within 0.2 m/s."""

SIGNALS = ("yaw rate", "lateral acceleration", "roll rate", "roll")
COLUMNS = ("yaw_rate_rad_s", "ay_m_s2", "roll_rate_rad_s", "roll_rad")


class Window(NamedTuple):
    """Part of a drive, from ``begin`` to before ``end`` (s of its file)."""

    begin: float
    end: float


RUN_IN = 1.0
"""Straight driving (s) before a window, for the transients of the start."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A drive sampled every ``SAMPLE``: n samples from ``begin`` (s) on.

    ``steering_wheel`` (rad) and ``speed`` (m/s) have shape (n,), ``signals`` (n, 4) the columns of
    ``SIGNALS``: rad/s, m/s², rad/s, rad.
    """

    begin: float
    steering_wheel: Vector
    speed: Vector
    signals: NDArray[np.float64]

    @property
    def time(self) -> Vector:
        """Times of the samples (s)."""
        return self.begin + SAMPLE * np.arange(len(self.speed))

    def inside(self, window: Window) -> NDArray[np.bool_]:
        """Which samples lie in ``window``."""
        half = SAMPLE / 2
        return (self.time > window.begin - half) & (self.time < window.end - half)


class Mounting(NamedTuple):
    """How a drive was measured: what a replay needs beyond the vehicle.

    ``steering_offset`` (rad at the steering wheel) is subtracted from the measured angle;
    ``steering_delay`` (s) is how much later the steering angle was stamped than the motion;
    ``roll_offset`` (rad) is the measured roll of a car that does not roll: the unit's own, and the
    road's bank. For checks: ``gravity`` is the share of g sin(roll) in the lateral acceleration, 0
    if the unit gives the horizontal acceleration, 1 if it gives the specific force along the body;
    ``crossfall`` is the change of the road's bank per metre to the left (rad/m).
    """

    steering_offset: float = 0.0
    steering_delay: float = 0.0
    roll_offset: float = 0.0
    gravity: float = 0.0
    crossfall: float = 0.0


def columns(path: Path) -> dict[str, Vector]:
    """Read the columns of a CSV file of numbers by the names in its first line.

    Raises:
        CanrollError: the file cannot be read, or lacks a column of a drive.
    """
    try:
        head, *lines = text(path).splitlines() or [""]
        rows = np.loadtxt(lines, delimiter=",", ndmin=2) if lines else np.empty((0, 0))
        table = dict(zip(head.split(","), rows.T, strict=bool(lines)))
    except (OSError, ValueError) as error:
        raise CanrollError(f"cannot read {path}: {reason(error)}") from error
    for name in ("time_s", "steering_wheel_rad", "speed_m_s", *COLUMNS):
        if name not in table:
            raise CanrollError(f"{path}: no column '{name}'")
    return table


def read(path: Path, window: Window) -> Measured:
    """Read the drive at ``path`` over ``window`` and the run-in before it.

    The samples are 10 ms apart, some of them lost and their time stamps off by up to 0.4 ms; all
    signals are interpolated linearly between the stamps.

    Raises:
        CanrollError: as :func:`columns`, or the file does not cover the window.
    """
    table = columns(path)
    stamps, begin = table["time_s"], window.begin - RUN_IN
    if not (stamps[0] <= begin and window.end <= stamps[-1]):
        raise CanrollError(f"{path}: does not cover {begin:g} to {window.end:g} s")
    time = begin + SAMPLE * np.arange(round((window.end - begin) / SAMPLE))
    names = ("steering_wheel_rad", "speed_m_s", *COLUMNS)
    steering, speed, *signals = (np.interp(time, stamps, table[name]) for name in names)
    return Measured(begin, steering, speed, np.column_stack(signals))


class _Run(NamedTuple):
    state: Vector
    inputs: Vector
    parameters: Vector
    outputs: Vector
    steer: Vector
    speed: Vector
    arm: Vector
    signals: NDArray[np.float64]
    position: Vector


@njit
def _drive_through(step: Any, run: _Run, mass: float) -> None:  # noqa: ANN401
    """Fill signals and position: the state before a step belongs to the time of the inputs."""
    motion = np.zeros(N_MOTION)
    step(run.state, run.inputs, run.parameters, run.outputs, 0.0)
    for k in range(len(run.steer)):
        if k % PER_SAMPLE == 0:
            specific_motion(run.inputs, run.outputs, run.arm, motion)
            roll = run.outputs[ports.ROLL]
            row = run.signals[k // PER_SAMPLE]
            row[0] = run.outputs[ports.YAW_RATE]
            row[1] = np.cos(roll) * motion[FORCE + 1] - np.sin(roll) * motion[FORCE + 2]
            row[2] = run.outputs[ports.ROLL_RATE]
            row[3] = roll
            run.position[k // PER_SAMPLE] = run.outputs[ports.Y]
        run.inputs[ports.STEER] = run.steer[k]
        error = run.speed[k] - run.outputs[ports.VX]
        run.inputs[ports.DRIVE_FORCE] = SPEED_GAIN * mass * error
        step(run.state, run.inputs, run.parameters, run.outputs, STEP)


def replay(vehicle: Vehicle, measured: Measured, mounting: Mounting) -> NDArray[np.float64]:
    """Drive the 14-DOF car with the measured steering, at the measured speed.

    The inertial unit sits at ``sensors.imu_position`` and gives, as the measured one, horizontal
    motion: the acceleration of its place along the horizontal to the car's left without gravity,
    and rates of the Euler angles.

    Returns:
        shape (n, 4): the columns of ``SIGNALS`` at the times of ``measured``.
    """
    body = bodies.body("nonlinear")
    fine = measured.begin + STEP * np.arange(len(measured.speed) * PER_SAMPLE)
    wheel = np.interp(fine + mounting.steering_delay, measured.time, measured.steering_wheel)
    steer = (wheel - mounting.steering_offset) / vehicle.steering.ratio
    speed = np.interp(fine, measured.time, measured.speed)
    state, parameters = body.build(vehicle, float(speed[0]))
    signals, position = np.empty_like(measured.signals), np.empty_like(measured.speed)
    arm, outputs = np.array(vehicle.sensors.imu_position), np.zeros(ports.N_OUTPUTS)
    run = _Run(state, initial_inputs(), parameters, outputs, steer, speed, arm, signals, position)
    _drive_through(body.step, run, vehicle.total_mass)
    bank = mounting.crossfall * position
    signals[:, 2] += np.gradient(bank, SAMPLE)
    signals[:, 3] += mounting.roll_offset + bank
    signals[:, 1] += mounting.gravity * GRAVITY * np.sin(signals[:, 3])
    return signals


def explained(measured: NDArray[np.float64], simulated: NDArray[np.float64]) -> Vector:
    """Return the variance accounted for, VAF = 1 − var(measured − simulated)/var(measured).

    Both have shape (n, signals), the samples of the window that is judged. A constant offset
    does not count.
    """
    return np.asarray(1.0 - np.var(measured - simulated, axis=0) / np.var(measured, axis=0))
