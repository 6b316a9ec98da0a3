"""Servo-valve and hydromotor of an electro-hydraulic anti-roll bar (Vu 2020, eqs. 1 to 7).

State of one axle: spool position and speed, load pressure, shaft angle and speed. The bar twists
by lever_ratio · roll angle of the suspension + shaft angle and resists roll. With the shaft held
at 0 it is a plain anti-roll bar, which is part of the vehicle's roll stiffness; the moment added by
the shaft's angle is the active moment. Load pressure is limited by the supply, the shaft angle by
its stops.
"""

import math
from typing import Any

import numpy as np

from canroll.plant_sim.kernels.jit import njit, stack_vector
from canroll.plant_sim.kernels.records import fields
from canroll.typing import Vector
from canroll.vehicles.model import ElectroHydraulicBars

SPOOL, SPOOL_RATE, PRESSURE, ANGLE, ANGLE_RATE = range(5)
VALVE = np.dtype(
    fields(
        "f8",
        "valve_frequency valve_damping valve_gain flow_gain displacement pressure_coefficient "
        "leakage leakage_by_rotation motor_inertia motor_damping bar_stiffness lever_ratio "
        "supply_pressure angle_limit oil_stiffness",
    )
)
"""Valve, motor and bar of an axle as the vehicle has them, and 4 bulk moduli per volume of oil."""

STEP = 1e-3


def parameters(data: ElectroHydraulicBars, *, thickening: float) -> Any:  # noqa: ANN401
    """A :data:`VALVE`; cold oil is ``thickening`` times as viscous: less leakage, more damping."""
    result = np.zeros(1, VALVE)[0]
    for name in (VALVE.names or ())[:-1]:
        result[name] = getattr(data, name)
    result["oil_stiffness"] = 4 * data.bulk_modulus / data.volume
    for name in ("pressure_coefficient", "leakage"):
        result[name] /= thickening
    result["motor_damping"] *= thickening
    return result


_slopes, _trial = stack_vector(20), stack_vector(5)


@njit
def active_moment(p: Any, angle: float) -> float:  # noqa: ANN401
    """Moment on the body (N·m), > 0 lifts the left, added by shaft ``angle`` (rad) to the bar's."""
    return float(-p.lever_ratio * p.bar_stiffness * angle)


@njit
def torque_loop(p: Any, bandwidth: float, demand: float, actual: float) -> float:  # noqa: ANN401
    """Valve current (A) that brings the active moment from ``actual`` to ``demand`` (N·m).

    The valve controls flow, so the moment is its integral: a proportional loop of ``bandwidth``
    (rad/s) suffices.
    """
    speed_per_ampere = p.valve_gain * p.flow_gain / p.displacement
    error = (actual - demand) / (p.lever_ratio * p.bar_stiffness)
    return float(bandwidth * error / speed_per_ampere)


@njit
def _derivative(x: Vector, p: Any, current: float, roll: float, rate: Vector) -> None:  # noqa: ANN401
    w = p.valve_frequency
    rate[SPOOL] = x[SPOOL_RATE]
    rate[SPOOL_RATE] = w * w * (p.valve_gain * current - x[SPOOL])
    rate[SPOOL_RATE] -= 2.0 * p.valve_damping * w * x[SPOOL_RATE]
    flow = p.flow_gain * x[SPOOL] - p.pressure_coefficient * x[PRESSURE]
    flow -= (p.displacement - p.leakage_by_rotation) * x[ANGLE_RATE] + p.leakage * x[PRESSURE]
    rate[PRESSURE] = p.oil_stiffness * flow
    rate[ANGLE] = x[ANGLE_RATE]
    torque = p.displacement * x[PRESSURE] - p.motor_damping * x[ANGLE_RATE]
    torque -= p.bar_stiffness * (p.lever_ratio * roll + x[ANGLE])
    rate[ANGLE_RATE] = torque / p.motor_inertia


@njit
def advance(motor: Vector, p: Any, current: float, roll: float, rate: float) -> bool:  # noqa: ANN401
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
    if abs(motor[PRESSURE]) > p.supply_pressure:
        motor[PRESSURE] = math.copysign(p.supply_pressure, motor[PRESSURE])
        bound = True
    if abs(motor[ANGLE]) > p.angle_limit:
        motor[ANGLE] = math.copysign(p.angle_limit, motor[ANGLE])
        motor[ANGLE_RATE] = 0.0
        bound = True
    return bound
