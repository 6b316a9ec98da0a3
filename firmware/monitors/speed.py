"""A speed that falls faster than brakes can: not believed, and the last one is kept.

Speed sets the authority of the law, and the other monitors rest at walking pace: a speed that reads
zero would let go of a car in the middle of a curve, unseen. What a car may have lost since the last
believed sample grows with time. Below walking pace nothing is believed once it has fallen so: a car
that stands keeps its last speed until it drives again.
"""

from canroll.firmware.calibration import STATE_MAX, Calibration
from canroll.firmware.plausibility import FAULT_SPEED
from canroll.firmware.state import AGE_MAX, RX_VEHICLE_MOTION, Ecu
from canroll.firmware.subset import clamp, i32, sat31

SPEED = 1


def least(ecu: Ecu, cal: Calibration) -> i32:
    """Return the least speed that may be by now; after a fall, walking pace at least."""
    lost: i32 = sat31(cal.speed_noise + ecu.speed_ticks * cal.speed_fall)
    floor: i32 = clamp(ecu.speed_fell * cal.fade_high, 0, ecu.speed_kept)
    return clamp(sat31(ecu.speed_kept - lost), floor, STATE_MAX)


def watch_speed(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Judge a new sample of the speed; keep the last believed one in its place."""
    ecu.speed_ticks = clamp(ecu.speed_ticks + elapsed, 0, AGE_MAX)
    if (ecu.fresh[RX_VEHICLE_MOTION] & ecu.valid[RX_VEHICLE_MOTION] & SPEED) != 0:
        if ecu.speed < least(ecu, cal):
            ecu.speed_fell = 1
        else:
            ecu.speed_fell = 0
            ecu.speed_kept = ecu.speed
            ecu.speed_ticks = 0
    if ecu.speed_fell == 1:
        ecu.speed = ecu.speed_kept
        ecu.detected = ecu.detected | (1 << FAULT_SPEED)
