"""Replay of the steering without control on the car with control.

A driver reacts to the effect of a law; with replayed steering only the car's response differs.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from canroll.plant_sim.driving.driver import FISHHOOK, FOLLOW_PATH, DriveInputs, off_path
from canroll.plant_sim.driving.maneuvers import Maneuver
from canroll.plant_sim.world.spool import pieces, with_signal
from canroll.runs.trace import Trace
from canroll.typing import Vector


def differs(maneuver: Maneuver, passive: Trace, controlled: Trace) -> bool:
    """Whether control changed the steering of a driver or steering robot with feedback.

    Otherwise, as on plants whose path does not depend on roll or with open-loop steering, a replay
    would equal the controlled run.
    """
    if maneuver.drive.kind not in (FOLLOW_PATH, FISHHOOK):
        return False
    both = zip(pieces(passive.signals, "steer"), pieces(controlled.signals, "steer"), strict=False)
    for (first,), (second,) in both:
        common = min(len(first), len(second))
        if not np.array_equal(first[:common], second[:common]):
            return True
    return False


def with_path_error(trace: Trace, drive: DriveInputs) -> Trace:
    """Return a replayed trace with its distance from the path, which no driver followed."""
    if drive.path_x.size <= 2:
        return trace
    return replace(
        trace, signals=with_signal(trace.signals, "path_error", path_error(trace, drive))
    )


def path_error(trace: Trace, drive: DriveInputs) -> Iterator[Vector]:
    """Yield the distance left of the path of ``drive``, m, one value per millisecond, in parts."""
    station = 0.0
    for x, y in pieces(trace.signals, "x", "y"):
        part = np.zeros(len(x))
        station = off_path(drive, station, x, y, part)
        yield part
