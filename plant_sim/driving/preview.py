"""Optimal preview control of steering: gains of the driver model by MacAdam.

C. C. MacAdam, "Application of an optimal preview control for simulation of closed-loop automobile
driving", IEEE Transactions on Systems, Man, and Cybernetics 11 (1981) 393-399. The driver predicts
the lateral displacement over the preview time T with the linear bicycle model behind the lag of the
arms, and chooses the constant steering demand whose mean square error to the path over T is least:

    demand = Σ g(τ) (path(τ) - F(τ) x) / Σ g(τ)²,   0 < τ <= T,

with F the free motion from the state x = (lateral velocity, yaw rate, road-wheel angle) and g the
motion per steering demand. Distances are in the axes of the car.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from canroll.typing import Vector
from vehicles import Vehicle
from vehicles.axles import axles

POINTS = 16
"""Points of the path that the driver looks at, equally spaced over the preview time."""

SPEED_STEP = 4.0
"""Step between the speeds of the table of gains (m/s), the lowest of them too."""

DAMPING = 0.45
"""Least damping ratio of the car with its driver: about 45° of phase margin, in the middle of what
McRuer found in people who track a target."""

LAGS = 3.0
"""Least preview in lags of the arms: in less the demand does not become steering."""

LONGEST = 3.0
"""Longest preview time (s)."""

Matrix = NDArray[np.float64]
_Y, _YAW, _VY, _RATE, _ANGLE = range(5)


def preview_time(vehicle: Vehicle, speed: float) -> float:
    """Shortest preview time (s) at which the linear car is damped by :data:`DAMPING` on a straight.

    A shorter one follows the path more closely. At ``speed`` (m/s); LONGEST if none is damped so.
    """
    a, b = bicycle(vehicle, speed)
    for time in np.arange(LAGS * vehicle.driver.lag, LONGEST, 0.02):
        poles = np.linalg.eigvals(a - b @ gains(a, b, time)[1][None, :])
        if (-poles.real >= DAMPING * np.abs(poles)).all():
            return round(float(time), 2)
    return LONGEST


def table(vehicle: Vehicle, speed: float, time: float) -> Vector:
    """Gains per lateral velocity, yaw rate, angle and offset of each point, row by row.

    The rows are at multiples of :data:`SPEED_STEP` up to at least ``speed`` (m/s), for the preview
    ``time`` (s).
    """
    rows = []
    for k in range(1, 2 + int(np.ceil(speed / SPEED_STEP))):
        per_offset, per_state = gains(*bicycle(vehicle, k * SPEED_STEP), time)
        rows.append(np.concatenate((per_state[_VY:], per_offset)))
    return np.concatenate(rows)


def bicycle(vehicle: Vehicle, speed: float) -> tuple[Matrix, Matrix]:
    """Linear bicycle model behind the arms: state y, yaw, v_y, yaw rate, road-wheel angle.

    Returns:
        A (5, 5) and B (5, 1) of the steering demand (rad), at ``speed`` (m/s).
    """
    front, rear = axles(vehicle)
    mass, inertia = vehicle.total_mass, vehicle.mass.yaw_inertia
    turning = front.ahead * front.cornering + rear.ahead * rear.cornering
    a, b = np.zeros((5, 5)), np.zeros((5, 1))
    a[_Y, _YAW], a[_Y, _VY], a[_YAW, _RATE] = speed, 1.0, 1.0
    a[_VY, _VY] = -(front.cornering + rear.cornering) / (mass * speed)
    a[_VY, _RATE] = -speed - turning / (mass * speed)
    a[_VY, _ANGLE] = front.cornering / mass
    a[_RATE, _VY] = -turning / (inertia * speed)
    damping = front.ahead**2 * front.cornering + rear.ahead**2 * rear.cornering
    a[_RATE, _RATE] = -damping / (inertia * speed)
    a[_RATE, _ANGLE] = front.ahead * front.cornering / inertia
    a[_ANGLE, _ANGLE], b[_ANGLE, 0] = -1.0 / vehicle.driver.lag, 1.0 / vehicle.driver.lag
    return a, b


def gains(a: Matrix, b: Matrix, time: float) -> tuple[Vector, Vector]:
    """Gains per lateral offset of the path (rad/m, POINTS) and per state of the car (5)."""
    step = expm(np.block([[a, b], [np.zeros((1, 6))]]) * (time / POINTS))
    moved, motion = np.eye(6), []
    for _ in range(POINTS):
        moved = step @ moved
        motion.append(moved[_Y])
    free, steered = np.split(np.array(motion), [5], axis=1)
    per_offset = steered[:, 0] / np.square(steered).sum()
    return per_offset, per_offset @ free
