"""All monitors, and what their findings do to the mode.

A monitor accuses for good, until the next ``init``: its evidence needs motion, which SAFE or the
end of a bend takes away. Without trustworthy strokes the gyro and the accelerometer still check
each other in the observer: that degrades. Any other finding is unsafe: what is wrong is what the
law needs or what acts on the body.
"""

from firmware.calibration import Calibration
from firmware.monitors.delivery import watch_delivery
from firmware.monitors.redundancy import watch_redundancy
from firmware.plausibility import DEGRADING, FAULT_STROKE_CONTRADICTED, GOOD, UNSAFE
from firmware.state import Ecu
from firmware.subset import i32

STROKES = 1 << FAULT_STROKE_CONTRADICTED


def watch(ecu: Ecu, cal: Calibration, elapsed: i32) -> i32:
    """Run all monitors; add what they have found to the faults and return its effect."""
    if (ecu.accused & STROKES) == 0:
        watch_redundancy(ecu, cal, elapsed)
    watch_delivery(ecu, cal)
    if ecu.accused == 0:
        return GOOD
    ecu.found = ecu.found | ecu.accused
    if ecu.accused == STROKES and ecu.lateral_lost == 0:
        return DEGRADING
    return UNSAFE
