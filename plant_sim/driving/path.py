"""Paths for the driver: points at equal steps of arc length, built from lanes or curvature."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from canroll.typing import Vector

XY = tuple[Vector, Vector]

STEP = 0.25
"""Arc length between the points of a path (m)."""


@dataclass(frozen=True, slots=True)
class Lane:
    """One lane of a cone track: from ``start`` over ``length`` along x (m), and across."""

    start: float
    length: float
    centre: float
    width: float


def double_lane_change(width: float, offset: float) -> tuple[Lane, ...]:
    """Lanes of ISO 3888-1 for a car of that ``width`` (m), x from the first lane's start.

    Lanes of 15, 25 and 30 m with transitions of 30 and 25 m in between; ``offset`` (m, 3.5 in the
    standard) is the distance between the right edges of the first and the side lane.
    """
    widths = [factor * width + 0.25 for factor in (1.1, 1.2, 1.3)]
    right = -widths[0] / 2
    return (
        Lane(0.0, 15.0, 0.0, widths[0]),
        Lane(45.0, 25.0, right + offset + widths[1] / 2, widths[1]),
        Lane(95.0, 30.0, right + widths[2] / 2, widths[2]),
    )


def obstacle_avoidance(width: float) -> tuple[Lane, ...]:
    """Lanes of ISO 3888-2 (the moose test) for a car of that ``width`` (m): 61 m in all.

    1 m between the first lane's left and the side lane's right edge; the last lane shares the
    first one's right edge and is at least 3 m wide.
    """
    first, side, last = 1.1 * width + 0.25, width + 1.0, max(1.3 * width + 0.25, 3.0)
    return (
        Lane(0.0, 12.0, 0.0, first),
        Lane(25.5, 11.0, first / 2 + 1.0 + side / 2, side),
        Lane(49.0, 12.0, last / 2 - first / 2, last),
    )


def straight(length: float) -> XY:
    """A straight of that ``length`` (m) along x."""
    x = np.arange(0.0, length, STEP)
    return x, np.zeros_like(x)


def through(lanes: tuple[Lane, ...], *, approach: float, run_out: float) -> XY:
    """The driver's target line: along each lane's centre, half cosines in between.

    ``approach`` (m) lies before the first lane, so that x = ``approach`` at its start.
    """
    x = np.arange(0.0, approach + lanes[-1].start + lanes[-1].length + run_out, 0.05)
    y = np.full_like(x, lanes[0].centre)
    for lane, following in pairwise(lanes):
        leave = approach + lane.start + lane.length
        arrive = approach + following.start
        part = np.clip((x - leave) / (arrive - leave), 0.0, 1.0)
        y += (following.centre - lane.centre) * 0.5 * (1.0 - np.cos(np.pi * part))
    return resample(x, y)


def from_curvature(sections: list[tuple[float, float]]) -> XY:
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


def resample(x: Vector, y: Vector) -> XY:
    """The same line at equal steps of arc length."""
    s = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    at = np.arange(0.0, s[-1], STEP)
    return np.interp(at, s, x), np.interp(at, s, y)
