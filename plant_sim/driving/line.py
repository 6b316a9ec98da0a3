"""The driver's line through the gates of a cone track: the one of least curvature that clears them.

Minimum-curvature line as of Heilmeier et al., "Minimum curvature trajectory planning and control
for an autonomous race car", Vehicle System Dynamics 58 (2020) 1497-1527, for headings so small that
the curvature is y''. Over steps of :data:`STEP` the curvature is constant; the outline of the car
stays within each lane while it is in it. That is a least-distance problem, solved by non-negative
least squares: Lawson and Hanson, "Solving Least Squares Problems" (1974), chapter 23.
"""

from functools import lru_cache
from math import inf

import numpy as np
from scipy.optimize import nnls

from canroll.plant_sim.driving.path import XY, Lane, resample, through
from canroll.typing import Vector

STEP = 0.5
"""Length of constant curvature (m)."""

RESERVE = 0.5
"""Share of the room between car and cones that the driver keeps free where the car can do it."""

CLOSEST = 0.1
"""Distance from the cones (m) that the driver keeps where it cannot, if the share is not less."""

SIDE_POINTS = 9
"""Points along the side of the car that pass the ends of a lane."""


def through_gates(
    lanes: tuple[Lane, ...], *, approach: float, run_out: float, curvature: float, **car: float
) -> XY:
    """Line of the centre of gravity through the lanes, straight before and after them.

    It keeps RESERVE from the cones, or CLOSEST where that takes more than ``curvature``. Where no
    line clears the cones it goes through the lanes' centres.

    Args:
        lanes: of the cone track.
        approach: straight before the first lane, m.
        run_out: straight after the last lane, m.
        curvature: that the car can follow, 1/m.
        car: its ``width``, and its bodywork ``front`` and ``rear`` of the centre of gravity, m.
    """
    xy = None
    for closest in (inf, CLOSEST):
        most, xy = _clearing(lanes, closest, approach=approach, run_out=run_out, **car)
        if most <= curvature:
            break
    return through(lanes, approach=approach, run_out=run_out) if xy is None else xy


@lru_cache(maxsize=16)
def _clearing(
    lanes: tuple[Lane, ...],
    closest: float,
    *,
    approach: float,
    run_out: float,
    front: float,
    rear: float,
    width: float,
) -> tuple[float, XY | None]:
    """Largest curvature (1/m) and points of the line that keeps RESERVE, or ``closest`` (m).

    Kept, as a population of cars of one body drives the same ones. Infinite and None: no line.
    """
    count = int((approach + lanes[-1].start + lanes[-1].length + run_out) / STEP)
    s = np.linspace(0.0, STEP * count, count + 1)
    heading = STEP * (np.arange(count)[None, :] < np.arange(count + 1)[:, None])
    across = heading * np.maximum(s[:, None] - s[None, :count] - STEP / 2, 0.0)
    after = heading[int((approach + lanes[-1].start + lanes[-1].length + rear) / STEP) + 1]
    rows, centres, rooms = [after], [0.0], [0.0]
    for x, along, lane in _clearances(lanes, front, rear):
        i, part = divmod((approach + x - along) / STEP, 1.0)
        both = across[int(i) : int(i) + 2] + along * heading[int(i) : int(i) + 2]
        rows.append((1.0 - part) * both[0] + part * both[1])
        centres.append(lane.centre)
        rooms.append(0.5 * (lane.width - width))
    clear, centre, room = np.array(rows), np.array(centres), np.array(rooms)
    free = room - np.minimum(closest, RESERVE * room)
    line = _least(np.vstack((clear, -clear)), np.concatenate((free + centre, free - centre)))
    if line is None:
        return inf, None
    y: Vector = across @ line
    return float(np.abs(line).max()), resample(s, y)


def _clearances(
    lanes: tuple[Lane, ...], front: float, rear: float
) -> list[tuple[float, float, Lane]]:
    """Places x (m) in the lanes and the point of the car's side, ahead of its CG, that is there.

    Within a lane the corners; at its ends, past which the car turns, all along the side.
    """
    corners, side = (front, -rear), np.linspace(front, -rear, SIDE_POINTS)
    points_to_clear = []
    for lane in lanes:
        places = lane.start + np.linspace(0.0, lane.length, 1 + int(lane.length))
        for k, x in enumerate(places):
            points = side if k in (0, len(places) - 1) else corners
            points_to_clear += [(float(x), float(along), lane) for along in points]
    return points_to_clear


def _least(rows: Vector, limits: Vector) -> Vector | None:
    """Return the shortest vector u with ``rows`` u <= ``limits``; None if there is none."""
    stacked = -np.vstack((rows.T, limits))
    target = np.append(np.zeros(rows.shape[1]), 1.0)
    residual = stacked @ nnls(stacked, target, maxiter=10 * len(rows))[0] - target
    if abs(residual[-1]) < 1e-9:
        return None
    return np.asarray(-residual[:-1] / residual[-1])
