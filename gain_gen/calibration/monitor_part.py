"""Calibration of the monitors: the roll dynamics they compare with, and their thresholds."""

from math import ceil, log2

import dbc
from firmware import calibration as fw
from gain_gen.calibration.rows import quantise
from gain_gen.models.task import Task
from vehicles.model import Vehicle
from vehicles.roll_stiffness import steady_roll, suspension_roll_stiffness

TURN_WASHOUT = 1.28
RESPONSE_WASHOUT = 2.56
"""Time constants of the leaky integrals of gyro less strokes and of the roll dynamics, s: a gyro
bias of 0.002 rad/s adds up to 0.15 degrees; the strokes' rates have no bias."""
SMOOTHING = 0.25
"""Share of the way to a new sample that the low-passed rate goes."""
GRAVITY = 9.81
LIMIT = 7.0
LIMIT_SHARE = 0.6
"""Acceleration above which wheels may lift and the residuals are not used: m/s², and share of the
static stability factor's."""
RESPONSE = 0.4
ROUGHNESS = 0.35
"""Thresholds of the roll dynamics: at rest, m/s², and share of the damping of the roughness."""
TURN = 0.006
WARP = 0.012
"""Thresholds of gyro against strokes and of front against rear strokes, rad."""
TYRE_SHARE = 0.5
"""Share of the tyres' deflection that is expected: half way from rigid tyres to the stated ones."""
DELIVERY_SHARE = 0.05
DELIVERY = 150.0
"""Edge of the band of delivered moments: share of an axle's largest moment, and N·m."""
SAMPLES = 5
"""Samples in a row beyond a threshold before a monitor accuses."""

Value = int | list[int]


def tyre_roll(vehicle: Vehicle) -> float:
    """Return the roll by the tyres' deflection per specific force, rad per m/s²."""
    body, front, rear = steady_roll(vehicle, suspension_roll_stiffness(vehicle))
    return 0.5 * (front + rear) / (1.0 + GRAVITY * body)


def monitor_fields(task: Task, axle_moment: float) -> dict[str, Value]:
    """Return the fields of the monitors.

    Args:
        task: task of the design.
        axle_moment: largest moment commanded at an axle, N·m, or 0 where commands are no moments.
    """
    vehicle = task.vehicle
    arm = vehicle.design.roll_arm
    # the accelerometer is above the roll axis and feels the roll acceleration itself
    height = vehicle.design.cg_height_above_roll_axis + vehicle.sensors.imu_position[2]
    inertia = max(vehicle.design.roll_inertia / arm - height, 0.0)
    limit = min(LIMIT, LIMIT_SHARE * GRAVITY * vehicle.static_stability_factor)
    step = max(dbc.period("Imu"), task.tick)
    damping = vehicle.design.roll_damping / arm
    edge = DELIVERY + DELIVERY_SHARE * axle_moment if axle_moment else 0.0

    def q(value: float, bits: int, name: str) -> int:
        return quantise(value, bits, 0, fw.COEFFICIENT, name=name)

    return {
        "turn_shift": max(1, round(log2(TURN_WASHOUT / step))),
        "response_shift": max(1, round(log2(RESPONSE_WASHOUT / step))),
        "monitor_limit": round(limit * 2.0**fw.Q_ACCELERATION),
        "monitor_gap_max": ceil(3 * step / task.tick),
        "monitor_samples": SAMPLES,
        "monitor_step": round(step * 2.0**fw.Q_UNIT),
        "monitor_stiffness": q(suspension_roll_stiffness(vehicle) / arm, 20, "monitor_stiffness"),
        "monitor_damping": q(damping, 20, "monitor_damping"),
        "monitor_inertia": q(inertia * SMOOTHING / (1.0 - SMOOTHING) / step, 20, "monitor_inertia"),
        "monitor_moment": q(1.0 / arm, 36, "monitor_moment"),
        "monitor_tyre": q(TYRE_SHARE * tyre_roll(vehicle), 30, "monitor_tyre"),
        "response_min": round(RESPONSE * 2.0**fw.Q_ACCELERATION),
        "response_rough": q(ROUGHNESS * damping, 20, "response_rough"),
        "turn_min": round(TURN * 2.0**fw.Q_RATE),
        "warp_min": round(WARP * 2.0**fw.Q_RATE),
        "delivery_min": round(edge * 2.0**fw.Q_MOMENT),
    }
