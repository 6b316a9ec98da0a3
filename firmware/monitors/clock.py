"""The inertial unit's clock against the ECU's, for samples at another rate than the law's.

Each sample counts one period of the unit, each tick one of the ECU, whether its frame was lost or
the tick was missed: what both have counted may differ by the way of a frame over the bus, which
does not grow. It is counted over a window. A step of the counter that is off by as much as a whole
window may be is no rate but a reset; that and a break in reception start the window anew. It is
reported until a whole window is good, and changes no mode: samples that come too late, too old or
not at all are judged as such.
"""

from firmware.calibration import Calibration
from firmware.fixed_point import magnitude
from firmware.plausibility import FAULT_SAMPLE_RATE_OFF
from firmware.state import AGE_MAX, FIRST_FRAME, RX_IMU, Ecu
from firmware.subset import clamp, i32, sat31


def start_window(ecu: Ecu) -> None:
    """Begin to count with the newest sample."""
    ecu.clock_error = 0
    ecu.clock_ticks = 0


def count_sample(ecu: Ecu, cal: Calibration) -> None:
    """Count the newest sample, and judge the window."""
    gap: i32 = ecu.clock_gap
    step: i32 = (ecu.imu_sample - ecu.clock_sample) & 15
    ecu.clock_gap = 0
    ecu.clock_sample = ecu.imu_sample
    ahead: i32 = sat31(step * cal.clock_period - gap * cal.tick_us)
    if gap > cal.timeout_ticks[RX_IMU] or magnitude(ahead) > cal.clock_limit:
        start_window(ecu)
        return
    ecu.clock_error = sat31(ecu.clock_error + ahead)
    ecu.clock_ticks = clamp(ecu.clock_ticks + gap, 0, AGE_MAX)
    if magnitude(ecu.clock_error) > cal.clock_limit:
        ecu.clock_off = 1
        start_window(ecu)
    elif ecu.clock_ticks >= cal.clock_window:
        ecu.clock_off = 0
        start_window(ecu)


def watch_clock(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Count the ticks, and the newest sample if there is one; report a rate that is off."""
    if cal.clock_period == 0:
        return
    ecu.clock_gap = clamp(ecu.clock_gap + elapsed, 0, AGE_MAX)
    if (ecu.fresh[RX_IMU] & FIRST_FRAME) != 0:
        count_sample(ecu, cal)
    ecu.detected = ecu.detected | (ecu.clock_off << FAULT_SAMPLE_RATE_OFF)


def init_clock(ecu: Ecu) -> None:
    """Start as after a break in reception."""
    ecu.clock_gap = AGE_MAX
