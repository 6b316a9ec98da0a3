"""The steering of the run without control, played back to the car with control.

A driver answers what a law does to the car; without him, what changes is the car alone.
"""

from dataclasses import replace

import numpy as np

from canroll.typing import Vector
from hil.runs.trace import Trace
from plant_sim.driving.driver import D_PATH_STEP, FISHHOOK, FOLLOW_PATH, Drive
from plant_sim.driving.maneuvers import Maneuver


def differs(maneuver: Maneuver, passive: Trace, controlled: Trace) -> bool:
    """Whether control changed what a driver or steering robot who watches the car steers.

    Where it did not, as on plants whose path does not depend on roll, a replay would be the
    controlled run once more; so it would where the steering was fixed from the beginning.
    """
    if maneuver.drive.kind not in (FOLLOW_PATH, FISHHOOK):
        return False
    first, second = passive.signals["steer"], controlled.signals["steer"]
    common = min(len(first), len(second))
    return not np.array_equal(first[:common], second[:common])


def with_path_error(trace: Trace, drive: Drive) -> Trace:
    """Return a replayed trace with its distance from the path, that no driver kept."""
    if drive.path_x.size <= 2:
        return trace
    return replace(trace, signals={**trace.signals, "path_error": path_error(trace, drive)})


def path_error(trace: Trace, drive: Drive) -> Vector:
    """Return the distance left of the path of ``drive``, m, a value a millisecond.

    The station goes along the path as the driver's does, at most 1 m a step, so that a path that
    crosses itself is followed in order.
    """
    step = float(drive.parameters[D_PATH_STEP])
    along_x, along_y = np.diff(drive.path_x), np.diff(drive.path_y)
    length = np.hypot(along_x, along_y)
    tangents = np.column_stack([along_x / length, along_y / length]).tolist()
    points = np.column_stack([drive.path_x, drive.path_y]).tolist()
    last, station = len(tangents) - 1, 0.0
    errors = []
    for x, y in zip(trace.signals["x"].tolist(), trace.signals["y"].tolist(), strict=True):
        place = min(int(station / step), last)
        tx, ty = tangents[place]
        beyond = station - place * step
        away_x = x - points[place][0] - beyond * tx
        away_y = y - points[place][1] - beyond * ty
        station += min(max(away_x * tx + away_y * ty, 0.0), 1.0)
        errors.append(away_y * tx - away_x * ty)
    return np.array(errors)
