"""A gain that grows with the roll angle: quiet straight ahead, the whole moment in a bend.

The law's moment is multiplied by a factor that rises from 1/4 below 0.1° to 1 above 0.6° of roll.
The angle that counts is the largest of late: it rises at once and falls by 1/64 of itself a tick,
so that the factor hardly changes within a swing.
"""

from typing import Annotated

from canroll.firmware.calibration import Q_ANGLE, STATE_MAX, Calibration
from canroll.firmware.state import ROLL, Ecu
from canroll.firmware.subset import F, clamp, i32, i64, record, rsh, sat31

# rad in Q30: 0.1° and 0.6°
LOW = 1874033
HIGH = 11244198
# factor in Q16
LEAST = 1 << 14
WHOLE = 1 << 16
# (WHOLE - LEAST) / (HIGH - LOW) in Q30
SLOPE = 5632449
FALL = 6


@record
class Progressive(Ecu):
    """The loop's state with that of this stage."""

    swing: Annotated[i32, F(0, STATE_MAX, Q_ANGLE, "rad", "largest roll angle of late")]
    factor: Annotated[i32, F(0, WHOLE, 16, "", "on the law's moment")]


def start(ecu: Progressive, cal: Calibration) -> None:
    """Start with the least gain."""
    ecu.factor = LEAST


def rest(ecu: Progressive, cal: Calibration) -> None:
    """Forget the swing while no law runs."""
    ecu.swing = 0
    ecu.factor = LEAST


def follow(ecu: Progressive, steps: i32) -> None:
    """Let the swing follow a larger roll angle at once, a smaller one slowly."""
    roll: i32 = ecu.x[ROLL]
    if roll < 0:
        roll = sat31(-roll)
    fall: i32 = rsh(ecu.swing, FALL)
    rest_of_it: i64 = ecu.swing - steps * fall
    ecu.swing = clamp(rest_of_it, 0, STATE_MAX)
    if roll > ecu.swing:
        ecu.swing = clamp(roll, 0, STATE_MAX)


def moment(ecu: Progressive, cal: Calibration, wanted: i32, output: i32, steps: i32) -> i32:
    """Return the law's moment times the factor of this roll angle."""
    if output == 0:
        follow(ecu, steps)
        above: i32 = clamp(ecu.swing - LOW, 0, HIGH - LOW)
        ecu.factor = clamp(LEAST + rsh(above * SLOPE, 30), LEAST, WHOLE)
    return sat31(rsh(wanted * ecu.factor, 16))
