"""Servo-valve and hydromotor of an electro-hydraulic anti-roll bar (Vu 2020, eqs. 1 to 7).

State of one axle: spool position and speed, load pressure, shaft angle and speed. The bar twists
by lever_ratio · roll angle of the suspension + shaft angle and resists roll. With the shaft held
at 0 it is a plain anti-roll bar, which is part of the vehicle's roll stiffness; the moment added by
the shaft's angle is the active moment. Load pressure is limited by the supply, the shaft angle by
its stops.
"""

import math

import numpy as np

from canroll.typing import Vector
from plant_sim.kernels.jit import njit, stack_vector
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


_slopes, _trial = stack_vector(20), stack_vector(5)


@njit
def active_moment(p: Vector, angle: float) -> float:
    """Moment on the body (N·m), > 0 lifts the left, added by shaft ``angle`` (rad) to the bar's."""
    return float(-p[LEVER] * p[BAR_STIFFNESS] * angle)


@njit
def torque_loop(p: Vector, bandwidth: float, demand: float, actual: float) -> float:
    """Valve current (A) that brings the active moment from ``actual`` to ``demand`` (N·m).

    The valve controls flow, so the moment is its integral: a proportional loop of ``bandwidth``
    (rad/s) suffices.
    """
    speed_per_ampere = p[VALVE_GAIN] * p[FLOW_GAIN] / p[DISPLACEMENT]
    error = (actual - demand) / (p[LEVER] * p[BAR_STIFFNESS])
    return float(bandwidth * error / speed_per_ampere)


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
def advance(motor: Vector, p: Vector, current: float, roll: float, rate: float) -> bool:
    """Advance one axle by 1 ms (RK4); return whether supply pressure or stroke limited it.

    ``roll`` and ``rate``: roll angle and rate of the suspension at the start of the step.
    """
    slope, x = _slopes().reshape((4, 5)), _trial()
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
