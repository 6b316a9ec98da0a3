"""Safety envelope: a second limiter around whatever the law commands, written apart from it.

It shares no function with the law and has limits of its own. A command never exceeds
``envelope_moment``, changes by at most ``envelope_slew`` a tick, and goes to zero once the
lateral acceleration is older than ``envelope_age``. It must not push the body outward for longer
than ``envelope_ticks``: a moment with the sign of the lateral acceleration lifts the inner side.
A law that damps or leads the motion does so while the acceleration falls, so that only what pushes
outward while it does not fall counts; then the outward side is closed until the law has stopped
wanting it for as long. Behind the allocation, every channel is kept within its actuator.
"""

from canroll.firmware.calibration import BARS, BYPASS, DAMPERS, SUSPENSION, VALVES, Calibration
from canroll.firmware.state import RX_IMU, RX_ROLL_REFERENCE, Ecu
from canroll.firmware.subset import clamp, i32, rsh, sat31, scaled


def outward(cal: Calibration, moment: i32, acceleration: i32, slow: i32) -> i32:
    """Return 1 where ``moment`` pushes outward while the acceleration does not fall.

    It falls where it is below its low-passed value ``slow`` by an eighth of the threshold above
    which directions are judged, several times the sensor's noise.
    """
    fallen: i32 = rsh(cal.envelope_lateral, 3)
    if moment > cal.envelope_outward and acceleration > cal.envelope_lateral:
        if acceleration > sat31(slow - fallen):
            return 1
    if moment < -cal.envelope_outward and acceleration < -cal.envelope_lateral:
        if acceleration < sat31(slow + fallen):
            return 1
    return 0


def wanted(ecu: Ecu, cal: Calibration) -> i32:
    """Return the moment to judge: the commanded one, of valves the one they deliver."""
    if cal.actuator == VALVES:
        return ecu.delivered[0] + ecu.delivered[1]
    return sat31(ecu.outputs[0] + ecu.outputs[1])


def watch_direction(ecu: Ecu, cal: Calibration, acceleration: i32, elapsed: i32) -> None:
    """Count how long the body has been pushed outward; cut beyond the limit, until it is over."""
    pushed: i32 = outward(cal, wanted(ecu, cal), acceleration, ecu.lateral_slow)
    change: i32 = -elapsed
    if pushed == 1:
        change = elapsed
    ecu.outward_ticks = clamp(ecu.outward_ticks + change, 0, cal.envelope_ticks)
    if ecu.outward_ticks == cal.envelope_ticks:
        ecu.outward_cut = 1
    elif ecu.outward_ticks == 0:
        ecu.outward_cut = 0
    change = scaled((acceleration - ecu.lateral_slow) * cal.envelope_pass, 30)
    ecu.lateral_slow = sat31(ecu.lateral_slow + change)


def enveloped(cal: Calibration, given: i32, last: i32, elapsed: i32) -> i32:
    """Return ``given`` within slew and moment limit; ``last`` left the envelope before."""
    step: i32 = sat31(elapsed * cal.envelope_slew)
    closer: i32 = sat31(last + clamp(given - last, -step, step))
    return clamp(closer, -cal.envelope_moment, cal.envelope_moment)


def guard(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Keep the outputs of the law within the envelope; ``envelope_acted`` says if it had to."""
    message: i32 = RX_IMU
    acceleration: i32 = ecu.acceleration_good
    if cal.observer == BYPASS:
        message = RX_ROLL_REFERENCE
        acceleration = ecu.reference_acceleration
    if ecu.lateral_lost == 0:
        watch_direction(ecu, cal, acceleration, elapsed)
    low: i32 = -cal.envelope_moment
    high: i32 = cal.envelope_moment
    if ecu.age[message] > cal.envelope_age:
        low = 0
        high = 0
    if ecu.outward_cut == 1:
        # the sign of a valve's current is not that of its moment
        if acceleration > 0 or cal.actuator == VALVES:
            high = 0
        if acceleration <= 0 or cal.actuator == VALVES:
            low = 0
    ecu.envelope_acted = 0
    for k in range(2):
        given: i32 = enveloped(cal, clamp(ecu.outputs[k], low, high), ecu.guarded[k], elapsed)
        if given != ecu.outputs[k]:
            ecu.envelope_acted = 1
        ecu.outputs[k] = given
        ecu.guarded[k] = given
    ecu.moment = sat31(ecu.outputs[0] + ecu.outputs[1])


def bounded(ecu: Ecu, value: i32, low: i32, high: i32) -> i32:
    """Return ``value`` within [low, high], noting where it was not."""
    if value < low or value > high:
        ecu.envelope_acted = 1
    return clamp(value, low, high)


def bound(ecu: Ecu, cal: Calibration) -> None:
    """Keep every channel of the command within its actuator, whatever the allocation made."""
    if cal.actuator == SUSPENSION:
        for corner in range(4):
            most: i32 = cal.force_max[corner]
            ecu.force[corner] = bounded(ecu, ecu.force[corner], -most, most)
    elif cal.actuator == BARS:
        for axle in range(2):
            largest: i32 = cal.bar_max[axle]
            ecu.bar[axle] = bounded(ecu, ecu.bar[axle], -largest, largest)
    else:
        least: i32 = -cal.current_max
        if cal.actuator == DAMPERS:
            least = 0
        for channel in range(4):
            ecu.current[channel] = bounded(ecu, ecu.current[channel], least, cal.current_max)
