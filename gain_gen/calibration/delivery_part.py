"""Calibration of the delivery monitor: how far a delivered moment may be from its commands."""

from math import ceil

import dbc
from firmware import calibration as fw
from gain_gen.models.task import Task

EDGE_SHARE = 0.05
EDGE = 150.0
"""Least width of the band's edges: share of an axle's largest moment, and N·m. In fault-free runs
up to the limit a delivered moment came to half an edge outside its band at most."""
LAGS = 0.05
"""Time by which a window exceeds the largest delay from sample to force, s: lag and way back."""
SAMPLES = 4
"""Samples in a row outside the band before an axle counts as failed."""


def delivery_fields(task: Task) -> dict[str, int | list[int]]:
    """Return the fields of the delivery monitor; it is off where commands are not moments."""
    period = max(dbc.period("ActuatorState"), task.tick)
    moment = _axle_moment(task)
    edge = EDGE + EDGE_SHARE * moment if moment else 0.0
    return {
        "delivery_window": min(ceil((task.delay.most + LAGS) / period), 1000),
        "delivery_samples": SAMPLES,
        "delivery_min": round(edge * 2.0**fw.Q_MOMENT),
    }


def _axle_moment(task: Task) -> float:
    """Return the largest moment of an axle, N·m; 0 where commands are not moments."""
    actuators, geometry = task.vehicle.actuators, task.vehicle.geometry
    if task.actuator == "suspension":
        track = 2.0 * max(geometry.half_track_front, geometry.half_track_rear)
        return track * actuators.suspension.force_limit
    return actuators.bars.torque_limit if task.actuator == "bars" else 0.0
