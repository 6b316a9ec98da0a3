"""Servo-valve and hydromotor of an electro-hydraulic anti-roll bar (Vu 2020, eqs. 1 to 7).

State of one axle: spool position and speed, load pressure, shaft angle and speed. The bar twists
by lever_ratio · roll angle of the suspension + shaft angle and resists roll. Two limits bind:
load pressure to the supply and shaft angle to its stops.
"""

import math

import numpy as np
from numpy.typing import NDArray

from plant_sim.jit import njit
from vehicles.model import ElectroHydraulicBars

SPOOL, SPOOL_RATE, PRESSURE, ANGLE, ANGLE_RATE = range(5)
(
    VALVE_FREQUENCY,
    VALVE_DAMPING,
    VALVE_GAIN,
    FLOW_GAIN,
    PRESSURE_COEFFICIENT,
    STIFFNESS_OF_OIL,
    DISPLACEMENT,
    LEAKAGE,
    LEAKAGE_BY_ROTATION,
    INERTIA,
    DAMPING,
    BAR_STIFFNESS,
    LEVER,
    SUPPLY,
    STOP,
    N_PARAMETERS,
) = range(16)

STEP = 1e-3
Vector = NDArray[np.float64]


def parameters(data: ElectroHydraulicBars, *, thickening: float) -> Vector:
    """Parameter vector; cold oil is ``thickening`` times as viscous: less leakage, more damping."""
    result = np.zeros(N_PARAMETERS)
    result[VALVE_FREQUENCY] = data.valve_frequency
    result[VALVE_DAMPING] = data.valve_damping
    result[VALVE_GAIN] = data.valve_gain
    result[FLOW_GAIN] = data.flow_gain
    result[PRESSURE_COEFFICIENT] = data.pressure_coefficient / thickening
    result[STIFFNESS_OF_OIL] = 4 * data.bulk_modulus / data.volume
    result[DISPLACEMENT] = data.displacement
    result[LEAKAGE] = data.leakage / thickening
    result[LEAKAGE_BY_ROTATION] = data.leakage_by_rotation
    result[INERTIA] = data.motor_inertia
    result[DAMPING] = data.motor_damping * thickening
    result[BAR_STIFFNESS] = data.bar_stiffness
    result[LEVER] = data.lever_ratio
    result[SUPPLY] = data.supply_pressure
    result[STOP] = data.angle_limit
    return result


@njit
def moment(motor: Vector, p: Vector, roll: float) -> float:
    """Moment on the body (N·m), > 0 lifts the left, at suspension roll angle ``roll`` (rad)."""
    return float(-p[LEVER] * p[BAR_STIFFNESS] * (p[LEVER] * roll + motor[ANGLE]))


@njit
def torque_loop(p: Vector, bandwidth: float, demand: float, actual: float, rate: float) -> float:
    """Valve current (A) that brings the moment from ``actual`` to ``demand`` (N·m).

    The valve commands flow, so the moment is its integral: a proportional loop of ``bandwidth``
    (rad/s), and the flow that the suspension's roll ``rate`` (rad/s) displaces fed forward.
    """
    speed_per_ampere = p[VALVE_GAIN] * p[FLOW_GAIN] / p[DISPLACEMENT]
    error = (actual - demand) / (p[LEVER] * p[BAR_STIFFNESS])
    return float((bandwidth * error - p[LEVER] * rate) / speed_per_ampere)


@njit
def _derivative(x: Vector, p: Vector, current: float, roll: float, rate: Vector) -> None:
    w = p[VALVE_FREQUENCY]
    rate[SPOOL] = x[SPOOL_RATE]
    rate[SPOOL_RATE] = w * w * (p[VALVE_GAIN] * current - x[SPOOL])
    rate[SPOOL_RATE] -= 2.0 * p[VALVE_DAMPING] * w * x[SPOOL_RATE]
    flow = p[FLOW_GAIN] * x[SPOOL] - p[PRESSURE_COEFFICIENT] * x[PRESSURE]
    flow -= (p[DISPLACEMENT] - p[LEAKAGE_BY_ROTATION]) * x[ANGLE_RATE] + p[LEAKAGE] * x[PRESSURE]
    rate[PRESSURE] = p[STIFFNESS_OF_OIL] * flow
    rate[ANGLE] = x[ANGLE_RATE]
    torque = p[DISPLACEMENT] * x[PRESSURE] - p[DAMPING] * x[ANGLE_RATE]
    torque -= p[BAR_STIFFNESS] * (p[LEVER] * roll + x[ANGLE])
    rate[ANGLE_RATE] = torque / p[INERTIA]


@njit
def advance(  # noqa: PLR0917
    motor: Vector, p: Vector, current: float, roll: float, rate: float, free: bool
) -> bool:
    """Advance one axle by 1 ms (RK4); whether supply pressure or stroke bound it.

    ``roll`` and ``rate``: roll of the suspension at the start of the step. ``free`` opens the
    bypass between the chambers: the shaft follows the bar and no moment is left.
    """
    if free:
        motor[:] = 0.0
        motor[ANGLE] = -p[LEVER] * (roll + STEP * rate)
        return False
    slope = np.empty((4, 5))
    x = np.empty(5)
    for stage in range(4):
        ahead = STEP * (0.0 if stage == 0 else 1.0 if stage == 3 else 0.5)
        for i in range(5):
            x[i] = motor[i] + (ahead * slope[stage - 1, i] if stage else 0.0)
        _derivative(x, p, current, roll + ahead * rate, slope[stage])
    for i in range(5):
        motor[i] += STEP / 6.0 * (slope[0, i] + 2.0 * (slope[1, i] + slope[2, i]) + slope[3, i])
    bound = False
    if abs(motor[PRESSURE]) > p[SUPPLY]:
        motor[PRESSURE] = math.copysign(p[SUPPLY], motor[PRESSURE])
        bound = True
    if abs(motor[ANGLE]) > p[STOP]:
        motor[ANGLE] = math.copysign(p[STOP], motor[ANGLE])
        motor[ANGLE_RATE] = 0.0
        bound = True
    return bound
