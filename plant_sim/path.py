"""Paths for the driver: points at equal steps of arc length, built from lanes or curvature."""

import numpy as np

from plant_sim.integrate import Vector

STEP = 0.25
"""Arc length between the points of a path (m)."""

DOUBLE_LANE_CHANGE_LENGTHS = (15.0, 30.0, 25.0, 25.0, 15.0, 15.0)
"""ISO 3888-1, table 1: lane, change, side lane, change back, lane, lane (m)."""


def double_lane_change(approach: float, offset: float, run_out: float) -> tuple[Vector, Vector]:
    """Centre line of the ISO 3888-1 track with smooth changes of lane.

    ``approach`` (m) lies before the first lane, ``run_out`` after the last; ``offset`` is the side
    lane's (3.5 m in the standard). The changes are half cosines over the standard's 30 and 25 m.
    """
    lane, out, side, back, *_ = DOUBLE_LANE_CHANGE_LENGTHS
    x = np.arange(0.0, approach + sum(DOUBLE_LANE_CHANGE_LENGTHS) + run_out, 0.05)
    first = np.clip((x - approach - lane) / out, 0.0, 1.0)
    second = np.clip((x - approach - lane - out - side) / back, 0.0, 1.0)
    y = offset * 0.5 * (np.cos(np.pi * second) - np.cos(np.pi * first))
    return resample(x, y)


def from_curvature(sections: list[tuple[float, float]]) -> tuple[Vector, Vector]:
    """Path from ``sections`` of (length, curvature at its end), curvature linear within each.

    Starts straight at the origin along x. Lengths in m, curvatures in 1/m, left positive; a
    section of constant curvature follows one that ends with it.
    """
    ends = np.cumsum([0.0] + [length for length, _ in sections])
    curvature = [0.0] + [value for _, value in sections]
    fine = 0.01
    s = np.arange(0.0, ends[-1], fine)
    k = np.interp(s + fine / 2, ends, curvature)
    heading = np.concatenate(([0.0], np.cumsum(k) * fine))
    middle = 0.5 * (heading[:-1] + heading[1:])
    x = np.concatenate(([0.0], np.cumsum(np.cos(middle)) * fine))
    y = np.concatenate(([0.0], np.cumsum(np.sin(middle)) * fine))
    return resample(x, y)


def resample(x: Vector, y: Vector) -> tuple[Vector, Vector]:
    """The same line at equal steps of arc length."""
    s = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    at = np.arange(0.0, s[-1], STEP)
    return np.interp(at, s, x), np.interp(at, s, y)
