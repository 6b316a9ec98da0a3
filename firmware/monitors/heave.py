"""What the springs carry, for corners that push both sides of an axle alike.

Such forces make no moment, so that neither a report of moments nor a balance of them tells of it.
But no command asks for them, and the springs of both axles together carry the body's weight,
whatever its load transfer to the front, rear or side: what they carry more or less for long is what
other corners bear. A road over hill and dale does that too, as little as its vertical curvature
makes of the body's weight; on a rough one samples of stroke rates that come late, twice or not at
all add up. What they carried at the start, and all that changes slowly, does not count. Which axle
pushes it does not tell. A finding lasts until the next ``init``.
"""

from firmware.calibration import Calibration
from firmware.fixed_point import product
from firmware.monitors.balance import (
    HEAVE,
    accuse_axles,
    deflect,
    mean_change,
    residual,
    start_balance,
)
from firmware.state import Ecu
from firmware.subset import i32, sat31


def watch_heave(ecu: Ecu, cal: Calibration) -> None:
    """Judge by the newest stroke rates what the springs carry, after the body's balance."""
    if cal.heave_min == 0:
        return
    if ecu.response_known == 0:
        start_balance(ecu, HEAVE, 0, 0)
        ecu.balance_ticks[HEAVE] = 0
        return
    front: i32 = product(ecu.stroke_rate[0] + ecu.stroke_rate[1], cal.heave_stretch[0], 23)
    rear: i32 = product(ecu.stroke_rate[2] + ecu.stroke_rate[3], cal.heave_stretch[1], 23)
    moved: i32 = sat31(front + rear)
    more: i32 = residual(ecu, cal, HEAVE, 0, 0)
    deflect(ecu, HEAVE, moved)
    mean: i32 = mean_change(ecu, cal, HEAVE, moved)
    late: i32 = product(mean, cal.heave_late, 10)
    accuse_axles(ecu, HEAVE, more, sat31(cal.heave_min + late), cal.heave_ticks)
