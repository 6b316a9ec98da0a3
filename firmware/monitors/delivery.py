"""Commanded against delivered moment, axle by axle.

Between a command and its moment lie the bus, a lag, a slew limit and the way back: a delivered
moment is right anywhere between the commands of the last one to two windows, and short of them
where the actuators report a limit. Stuck, dead, reversed, slow and runaway actuators leave that
band, whatever status they report, as do actuators that follow somebody else. An axle that does so
counts as failed until the next ``init``: the evidence needs a command, which SAFE takes away.
"""

from canroll.firmware.calibration import BARS, STATE_MAX, STATE_MIN, SUSPENSION, Calibration
from canroll.firmware.fixed_point import product, with_share
from canroll.firmware.monitors.residual import DELIVERY, judge
from canroll.firmware.plausibility import NEEDED, STUCK
from canroll.firmware.state import FIRST_FRAME, RX_ACTUATOR_STATE, Ecu
from canroll.firmware.subset import clamp, i32


def note_command(ecu: Ecu, cal: Calibration) -> None:
    """Remember the moments of the command that is being sent."""
    if cal.actuator == SUSPENSION:
        ecu.commanded[0] = product(ecu.force[0] - ecu.force[1], cal.track_front, 29)
        ecu.commanded[1] = product(ecu.force[2] - ecu.force[3], cal.track_rear, 29)
    elif cal.actuator == BARS:
        ecu.commanded[0] = ecu.bar[0]
        ecu.commanded[1] = ecu.bar[1]


def widen(ecu: Ecu, axle: i32, moment: i32) -> None:
    """Make ``moment`` a part of the present window's band."""
    ecu.band_high[axle] = clamp(ecu.band_high[axle], moment, STATE_MAX)
    ecu.band_low[axle] = clamp(ecu.band_low[axle], STATE_MIN, moment)


def open_window(ecu: Ecu, axle: i32) -> None:
    """Make the present window the one before, and open one with the present command alone."""
    ecu.band_high[axle + 2] = ecu.band_high[axle]
    ecu.band_low[axle + 2] = ecu.band_low[axle]
    ecu.band_high[axle] = ecu.commanded[axle]
    ecu.band_low[axle] = ecu.commanded[axle]


def outside(ecu: Ecu, cal: Calibration, axle: i32) -> i32:
    """Return 1 where the moment delivered at an axle is outside the band of its commands."""
    high: i32 = clamp(ecu.band_high[axle], ecu.band_high[axle + 2], STATE_MAX)
    low: i32 = clamp(ecu.band_low[axle], STATE_MIN, ecu.band_low[axle + 2])
    size: i32 = clamp(high, -low, STATE_MAX)
    edge: i32 = with_share(cal.delivery_min, size, cal.delivery_share)
    if ecu.delivered[axle] > high + edge or ecu.delivered[axle] < low - edge:
        return 1
    return 0


def watch_axle(ecu: Ecu, cal: Calibration, axle: i32) -> None:
    """Judge a new sample of an axle's delivered moment."""
    if ecu.commands_sent == 0:
        # what is delivered yet was commanded before a restart
        widen(ecu, axle, ecu.delivered[axle])
        return
    status: i32 = ecu.status[2 * axle] | ecu.status[2 * axle + 1]
    if (ecu.enabled & ecu.command_held) == 0 or status >= STUCK:
        # nothing follows the commands; afterwards what does starts from zero
        judge(ecu, DELIVERY + axle, 0, cal.delivery_samples)
        widen(ecu, axle, 0)
        return
    widen(ecu, axle, ecu.commanded[axle])
    if status != 0:
        widen(ecu, axle, 0)
    judge(ecu, DELIVERY + axle, outside(ecu, cal, axle), cal.delivery_samples)


def watch_delivery(ecu: Ecu, cal: Calibration) -> None:
    """Judge a new sample of the delivered moments, where commands are moments."""
    if cal.delivery_min == 0 or (ecu.fresh[RX_ACTUATOR_STATE] & FIRST_FRAME) == 0:
        return
    if (ecu.valid[RX_ACTUATOR_STATE] & NEEDED[RX_ACTUATOR_STATE]) != NEEDED[RX_ACTUATOR_STATE]:
        # the moments are those of an earlier sample
        return
    ecu.window_samples = clamp(ecu.window_samples + 1, 0, cal.delivery_window)
    for axle in range(2):
        if ecu.window_samples == cal.delivery_window:
            open_window(ecu, axle)
        watch_axle(ecu, cal, axle)
    if ecu.window_samples == cal.delivery_window:
        ecu.window_samples = 0
