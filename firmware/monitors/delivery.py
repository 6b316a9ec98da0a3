"""Commanded against delivered moment, axle by axle.

Between a command and its moment lie the bus, a lag, a slew limit and the way back: a delivered
moment is right anywhere between the commands of the last tenth of a second, and short of them where
the actuators report a limit. Stuck, dead, reversed, slow, weak and runaway actuators leave that
band, whatever status they report.
"""

from firmware.calibration import BARS, STATE_MAX, STATE_MIN, SUSPENSION, Calibration
from firmware.fixed_point import product
from firmware.plausibility import FAULT_ACTUATOR_CONTRADICTED, STUCK
from firmware.state import RX_ACTUATOR_STATE, Ecu
from firmware.subset import byte, clamp, i32, rsh, sat31

LIMITED = 1
# the band closes by an eighth a sample, its edges are a quarter of its size wide
CLOSING = 3
SHARE = 2


def note_command(ecu: Ecu, cal: Calibration) -> None:
    """Remember the moments of the command that is being sent."""
    if cal.actuator == SUSPENSION:
        ecu.commanded[0] = product(ecu.force[0] - ecu.force[1], cal.track_front, 29)
        ecu.commanded[1] = product(ecu.force[2] - ecu.force[3], cal.track_rear, 29)
    elif cal.actuator == BARS:
        ecu.commanded[0] = ecu.bar[0]
        ecu.commanded[1] = ecu.bar[1]


def outside(ecu: Ecu, cal: Calibration, axle: i32) -> i32:
    """Return 1 where the moment delivered at an axle is outside the band of its commands."""
    status: i32 = ecu.status[2 * axle] | ecu.status[2 * axle + 1]
    high: i32 = ecu.band_high[axle]
    low: i32 = ecu.band_low[axle]
    if status == LIMITED:
        high = clamp(high, 0, STATE_MAX)
        low = clamp(low, STATE_MIN, 0)
    size: i32 = high
    if -low > high:
        size = -low
    edge: i32 = sat31(cal.delivery_min + rsh(clamp(size, 0, STATE_MAX), SHARE))
    if ecu.delivered[axle] > high + edge or ecu.delivered[axle] < low - edge:
        return 1
    return 0


def watch_axle(ecu: Ecu, cal: Calibration, axle: i32) -> i32:
    """Move the band of an axle's commands by a sample; return 1 where it has been left for long."""
    command: i32 = ecu.commanded[axle]
    high: i32 = ecu.band_high[axle]
    low: i32 = ecu.band_low[axle]
    high = sat31(high + rsh(command - high, CLOSING))
    low = sat31(low + rsh(command - low, CLOSING))
    ecu.band_high[axle] = clamp(high, command, STATE_MAX)
    ecu.band_low[axle] = clamp(low, STATE_MIN, command)
    if ecu.status[2 * axle] >= STUCK or ecu.status[2 * axle + 1] >= STUCK:
        # it says so itself
        return 0
    if outside(ecu, cal, axle) == 0:
        ecu.astray[axle] = 0
        return 0
    ecu.astray[axle] = byte(clamp(ecu.astray[axle] + 1, 0, cal.monitor_samples))
    if ecu.astray[axle] == cal.monitor_samples:
        return 1
    return 0


def watch_delivery(ecu: Ecu, cal: Calibration) -> None:
    """Judge a new sample of the delivered moments, where commands are moments."""
    if cal.delivery_min == 0 or ecu.fresh[RX_ACTUATOR_STATE] == 0:
        return
    if ecu.enabled == 0 or ecu.command_held == 0:
        # nothing follows the commands, or not yet
        for axle in range(2):
            ecu.astray[axle] = 0
        return
    for axle in range(2):
        if watch_axle(ecu, cal, axle) == 1:
            ecu.accused = ecu.accused | (1 << FAULT_ACTUATOR_CONTRADICTED)
