"""Optimal preview control of steering: gains of the driver model by MacAdam.

C. C. MacAdam, "Application of an optimal preview control for simulation of closed-loop automobile
driving", IEEE Transactions on Systems, Man, and Cybernetics 11 (1981) 393-399. The driver predicts
the lateral displacement over the preview time T with the linear bicycle model behind the lag of the
arms, and chooses the constant steering demand whose mean square error to the path over T is least:

    demand = Σ g(τ) (path(τ) - F(τ) x) / Σ g(τ)²,   0 < τ <= T,

with F the free motion from the state x = (lateral velocity, yaw rate, road-wheel angle) and g the
motion per steering demand. Distances are in the axes of the car.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from canroll.typing import Vector
from canroll.vehicles import Vehicle
from canroll.vehicles.axles import axles

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


BLOCK = 8
"""Preview times that are tried at once."""


def preview_time(vehicle: Vehicle, speed: float) -> float:
    """Shortest preview time (s) at which the linear car is damped by :data:`DAMPING` on a straight.

    A shorter one follows the path more closely. At ``speed`` (m/s); LONGEST if none is damped so.
    """
    return _shortest(_numbers(vehicle), speed)


@lru_cache(maxsize=16)
def _shortest(numbers: tuple[float, ...], speed: float) -> float:
    a, b = _bicycle(numbers, speed)
    times = np.arange(LAGS * numbers[-1], LONGEST, 0.02)
    for first in range(0, len(times), BLOCK):
        some = times[first : first + BLOCK]
        driven = a - b * gains(a, b, some)[1][:, None, :]
        poles = np.linalg.eigvals(driven)
        damped = (-poles.real >= DAMPING * np.abs(poles)).all(axis=1)
        if damped.any():
            return round(float(some[damped.argmax()]), 2)
    return LONGEST


def table(vehicle: Vehicle, speed: float, time: float) -> Vector:
    """Gains per lateral velocity, yaw rate, angle and offset of each point, row by row.

    The rows are at multiples of :data:`SPEED_STEP` up to at least ``speed`` (m/s), for the preview
    ``time`` (s).
    """
    return _table(_numbers(vehicle), 1 + int(np.ceil(speed / SPEED_STEP)), time).copy()


@lru_cache(maxsize=16)
def _table(numbers: tuple[float, ...], rows: int, time: float) -> Vector:
    models = [_bicycle(numbers, k * SPEED_STEP) for k in range(1, 1 + rows)]
    a, b = map(np.array, zip(*models, strict=True))
    per_offset, per_state = gains(a, b, np.full(rows, time))
    return np.concatenate((per_state[:, _VY:], per_offset), axis=1).ravel()


def bicycle(vehicle: Vehicle, speed: float) -> tuple[Matrix, Matrix]:
    """Linear bicycle model behind the arms: state y, yaw, v_y, yaw rate, road-wheel angle.

    Returns:
        A (5, 5) and B (5, 1) of the steering demand (rad), at ``speed`` (m/s).
    """
    return _bicycle(_numbers(vehicle), speed)


def _numbers(vehicle: Vehicle) -> tuple[float, ...]:
    """What the gains depend on besides the speed."""
    front, rear = axles(vehicle)
    return (
        *(vehicle.total_mass, vehicle.mass.yaw_inertia),
        *(front.ahead, front.cornering, rear.ahead, rear.cornering, vehicle.driver.lag),
    )


def _bicycle(numbers: tuple[float, ...], speed: float) -> tuple[Matrix, Matrix]:
    mass, inertia, front, front_cornering, rear, rear_cornering, lag = numbers
    turning = front * front_cornering + rear * rear_cornering
    a, b = np.zeros((5, 5)), np.zeros((5, 1))
    a[_Y, _YAW], a[_Y, _VY], a[_YAW, _RATE] = speed, 1.0, 1.0
    a[_VY, _VY] = -(front_cornering + rear_cornering) / (mass * speed)
    a[_VY, _RATE] = -speed - turning / (mass * speed)
    a[_VY, _ANGLE] = front_cornering / mass
    a[_RATE, _VY] = -turning / (inertia * speed)
    damping = front**2 * front_cornering + rear**2 * rear_cornering
    a[_RATE, _RATE] = -damping / (inertia * speed)
    a[_RATE, _ANGLE] = front * front_cornering / inertia
    a[_ANGLE, _ANGLE], b[_ANGLE, 0] = -1.0 / lag, 1.0 / lag
    return a, b


def gains(a: Matrix, b: Matrix, time: ArrayLike) -> tuple[Matrix, Matrix]:
    """Gains per lateral offset of the path (rad/m, POINTS) and per state of the car (5).

    ``a``, ``b`` and ``time`` (s) may be several: the gains have the same first dimensions then.
    """
    share = np.asarray(time)[..., None, None] / POINTS
    both = np.zeros((*share.shape[:-2], 6, 6))
    both[..., :5, :5], both[..., :5, 5:] = a, b
    step = expm(both * share)
    moved, motion = np.eye(6), []
    for _ in range(POINTS):
        moved = step @ moved
        motion.append(moved[..., _Y, :])
    free, steered = np.split(np.stack(motion, axis=-2), [5], axis=-1)
    per_offset = steered[..., 0] / np.square(steered[..., 0]).sum(axis=-1, keepdims=True)
    return per_offset, (per_offset[..., None, :] @ free)[..., 0, :]
