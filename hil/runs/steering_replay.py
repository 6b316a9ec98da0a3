"""Replay of the steering without control on the car with control.

A driver reacts to the effect of a law; with replayed steering only the car's response differs.
"""

from dataclasses import replace

import numpy as np

from canroll.typing import Vector
from hil.runs.trace import Trace
from plant_sim.driving.driver import D_PATH_STEP, FISHHOOK, FOLLOW_PATH, Drive
from plant_sim.driving.maneuvers import Maneuver
from plant_sim.world.spool import pieces, with_signal


def differs(maneuver: Maneuver, passive: Trace, controlled: Trace) -> bool:
    """Whether control changed the steering of a driver or steering robot with feedback.

    Otherwise, as on plants whose path does not depend on roll or with open-loop steering, a replay
    would equal the controlled run.
    """
    if maneuver.drive.kind not in (FOLLOW_PATH, FISHHOOK):
        return False
    first, second = passive.signals["steer"], controlled.signals["steer"]
    common = min(len(first), len(second))
    return not np.array_equal(first[:common], second[:common])


def with_path_error(trace: Trace, drive: Drive) -> Trace:
    """Return a replayed trace with its distance from the path, which no driver followed."""
    if drive.path_x.size <= 2:
        return trace
    return replace(
        trace, signals=with_signal(trace.signals, "path_error", path_error(trace, drive))
    )


def path_error(trace: Trace, drive: Drive) -> Vector:
    """Return the distance left of the path of ``drive``, m, one value per millisecond.

    The station advances along the path like the driver's, at most 1 m per step, so that a path that
    crosses itself is followed in order.
    """
    step = float(drive.parameters[D_PATH_STEP])
    along_x, along_y = np.diff(drive.path_x), np.diff(drive.path_y)
    length = np.hypot(along_x, along_y)
    tangents = np.column_stack([along_x / length, along_y / length]).tolist()
    points = np.column_stack([drive.path_x, drive.path_y]).tolist()
    last, station = len(tangents) - 1, 0.0
    errors = np.zeros(len(trace.signals["x"]))
    number = 0
    for xs, ys in pieces(trace.signals, "x", "y"):
        for x, y in zip(xs.tolist(), ys.tolist(), strict=True):
            place = min(int(station / step), last)
            tx, ty = tangents[place]
            beyond = station - place * step
            away_x = x - points[place][0] - beyond * tx
            away_y = y - points[place][1] - beyond * ty
            station += min(max(away_x * tx + away_y * ty, 0.0), 1.0)
            errors[number] = away_y * tx - away_x * ty
            number += 1
    return errors
