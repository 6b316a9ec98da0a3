"""Reported moments against the body's response, for actuators that report what they do not do.

The body rolls about its axis by what acts on it: springs and dampers, whose stroke rates are
measured, the lateral acceleration and the delivered moments. What is left of that balance is the
difference between true and reported moments, whatever the road does, for it acts through the
springs. All of it is washed out, so that no offset counts, and low-passed, so that the roll
acceleration is got from the roll rate without a derivative. What the model may be wrong by is a
quarter of all that acts. Where more is left for a while, no axle is believed: the sum does not tell
which. A finding lasts until the next ``init``.
"""

from firmware.calibration import STATE_MAX, Calibration
from firmware.fixed_point import product
from firmware.monitors.redundancy import lasting, magnitude
from firmware.plausibility import NEEDED
from firmware.state import RX_ACTUATOR_STATE, RX_IMU, RX_SUSPENSION_RATE, Ecu
from firmware.subset import clamp, i32, rsh, sat31

# bits of ecu.valid of an Imu frame: roll rate and lateral acceleration
ROLL_AND_LATERAL = 3
# a quarter of all that acts
SHARE = 2


def known(ecu: Ecu, cal: Calibration) -> i32:
    """Return 1 where all that acts on the body is known, and the actuators follow commands."""
    moment: i32 = NEEDED[RX_ACTUATOR_STATE]
    stroke: i32 = NEEDED[RX_SUSPENSION_RATE]
    if (ecu.valid[RX_IMU] & ROLL_AND_LATERAL) != ROLL_AND_LATERAL or ecu.lateral_lost == 1:
        return 0
    if (ecu.valid[RX_ACTUATOR_STATE] & moment) != moment or ecu.moment_unknown == 1:
        return 0
    if (ecu.valid[RX_SUSPENSION_RATE] & stroke) != stroke:
        return 0
    # a frame that repeats its sample is no news
    if ecu.unchanged[RX_SUSPENSION_RATE] > cal.timeout_ticks[RX_SUSPENSION_RATE]:
        return 0
    if ecu.unchanged[RX_IMU] > cal.timeout_ticks[RX_IMU]:
        return 0
    if ecu.gain_factor == 0:
        return 0
    return ecu.enabled & ecu.command_held


def watch_response(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Judge by the newest samples what acts on the body; a missed tick breaks its integral.

    Frames come early and late, so that there are ticks with two of them and ticks with none.
    """
    if cal.response_min == 0:
        return
    if elapsed > 1 or known(ecu, cal) == 0:
        ecu.response_known = 0
        return
    front: i32 = product(ecu.stroke_rate[0] - ecu.stroke_rate[1], cal.response_stroke[0], 23)
    rear: i32 = product(ecu.stroke_rate[2] - ecu.stroke_rate[3], cal.response_stroke[1], 23)
    damping: i32 = sat31(front + rear)
    moment: i32 = sat31(ecu.delivered[0] + ecu.delivered[1])
    lateral: i32 = product(ecu.lateral_acceleration, cal.response_lateral, 20)
    momentum: i32 = product(ecu.roll_rate, cal.response_inertia, 23)
    acting: i32 = sat31(damping - moment - lateral)
    if ecu.response_known == 0:
        ecu.response_known = 1
        ecu.response_spring = sat31(-acting)
        ecu.response_slow = sat31(-momentum)
        ecu.response_size = 0
    washed: i32 = sat31(ecu.response_spring + acting)
    stretched: i32 = product(damping, cal.response_stretch, 30)
    ecu.response_spring = sat31(
        ecu.response_spring + stretched - product(washed, cal.response_wash, 30)
    )
    behind: i32 = sat31(washed - momentum - ecu.response_slow)
    ecu.response_slow = sat31(ecu.response_slow + product(behind, cal.response_pass, 30))
    left: i32 = magnitude(sat31(ecu.response_slow + momentum))
    size: i32 = rsh(magnitude(damping) + magnitude(moment) + magnitude(lateral), SHARE)
    faded: i32 = ecu.response_size - product(ecu.response_size, cal.response_wash, 31)
    ecu.response_size = clamp(size, faded, STATE_MAX)
    bad: i32 = 0
    if left > ecu.response_size + cal.response_min:
        bad = 1
    ecu.response_ticks = lasting(ecu.response_ticks, bad, cal.response_ticks)
    if ecu.response_ticks == cal.response_ticks:
        ecu.contradicted[0] = 1
        ecu.contradicted[1] = 1
