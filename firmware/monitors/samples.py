"""Samples of the sensors: at which rate they come, and whether they jump as no car can move.

Reported until it is over, and no mode changes by it: a jump may be a spike, and what wrong, late
and old samples do is judged by the other monitors, samples that do not come as such.

Each sample of the inertial unit counts one period of its clock, each tick one of the ECU's, whether
its frame was lost or the tick was missed: what both have counted in a window may differ by the way
of a frame over the bus, which does not grow. A step of the counter that is off by as much as a
whole window may be is no rate but a reset; that and a break in reception start the window anew.

From sample to sample a car's motion bends little: the second difference is small, whatever the
manoeuvre, and a steady change has none. Squared in units of the largest that may be, it is summed
up over a window that forgets a share with each sample: the sum exceeds one soon after a jump and
while a signal is noisy. A signal without a valid value starts anew, and so do all of a message
where samples are missing: those of a car that turns are far apart. So do those of a further frame
without a new sample.
"""

from canroll.firmware.calibration import Calibration
from canroll.firmware.fixed_point import magnitude
from canroll.firmware.plausibility import FAULT_SAMPLE_RATE_OFF, FAULT_SENSOR_ERRATIC
from canroll.firmware.state import AGE_MAX, FIRST_FRAME, RX_IMU, RX_VEHICLE_MOTION, Ecu
from canroll.firmware.subset import byte, clamp, i32, rsh, sat31

# messages
UNIT = 0
MOTION = 1
# samples in a row from which a second difference is known
KNOWN = 3
# the largest second difference that may be, squared; none counts as more than four of them
ONE_SQUARE = 1 << 12
MOST = 1 << 14


def start_window(ecu: Ecu) -> None:
    """Begin to count with the newest sample."""
    ecu.clock_error = 0
    ecu.clock_ticks = 0


def count_sample(ecu: Ecu, cal: Calibration, step: i32) -> None:
    """Count the unit's newest sample, ``step`` after the last, and judge the window."""
    gap: i32 = ecu.sample_gap[UNIT]
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


def watch_signal(ecu: Ecu, cal: Calibration, k: i32, value: i32, known: i32) -> None:
    """Judge the newest sample of signal ``k``, of which at most ``known`` in a row are."""
    step: i32 = sat31(value - ecu.erratic_last[k])
    bend: i32 = sat31(step - ecu.erratic_step[k])
    ecu.erratic_last[k] = value
    ecu.erratic_step[k] = step
    total: i32 = rsh(ecu.erratic_sum[k] * cal.erratic_kept[k], 30)
    ecu.erratic_known[k] = byte(clamp(ecu.erratic_known[k] + 1, 0, known))
    if ecu.erratic_known[k] == KNOWN:
        bend = clamp(rsh(bend * cal.erratic_scale[k], 30), -MOST, MOST)
        total = total + rsh(bend * bend, 12)
    ecu.erratic_sum[k] = total
    if total > ONE_SQUARE:
        ecu.detected = ecu.detected | (1 << FAULT_SENSOR_ERRATIC)


def samples_known(ecu: Ecu, cal: Calibration, group: i32, step: i32) -> i32:
    """Return how many samples of a message may be known with its newest: 1 if one is missing."""
    gap: i32 = ecu.sample_gap[group]
    ecu.sample_gap[group] = 0
    if gap > cal.erratic_gap[group] or step != cal.erratic_samples[group]:
        return 1
    return KNOWN


def watch_unit(ecu: Ecu, cal: Calibration) -> None:
    """Judge the newest samples of the inertial unit."""
    step: i32 = (ecu.imu_sample - ecu.sample_count[UNIT]) & 15
    ecu.sample_count[UNIT] = ecu.imu_sample
    if cal.clock_period != 0:
        count_sample(ecu, cal, step)
    valid: i32 = ecu.valid[RX_IMU] & ecu.fresh[RX_IMU]
    known: i32 = samples_known(ecu, cal, UNIT, step)
    watch_signal(ecu, cal, 0, ecu.roll_rate, known * (valid & 1))
    watch_signal(ecu, cal, 1, ecu.lateral_acceleration, known * ((valid >> 1) & 1))
    watch_signal(ecu, cal, 2, ecu.yaw_rate, known * ((valid >> 2) & 1))


def watch_motion(ecu: Ecu, cal: Calibration) -> None:
    """Judge the newest samples of speed and steering angle."""
    step: i32 = (ecu.motion_sample - ecu.sample_count[MOTION]) & 15
    ecu.sample_count[MOTION] = ecu.motion_sample
    valid: i32 = ecu.valid[RX_VEHICLE_MOTION] & ecu.fresh[RX_VEHICLE_MOTION]
    known: i32 = samples_known(ecu, cal, MOTION, step)
    watch_signal(ecu, cal, 3, ecu.speed, known * (valid & 1))
    watch_signal(ecu, cal, 4, ecu.steering, known * ((valid >> 1) & 1))


def watch_samples(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Count the ticks, and judge the newest samples of motion and driver."""
    for group in range(2):
        ecu.sample_gap[group] = clamp(ecu.sample_gap[group] + elapsed, 0, AGE_MAX)
    if (ecu.fresh[RX_IMU] & FIRST_FRAME) != 0:
        watch_unit(ecu, cal)
    if (ecu.fresh[RX_VEHICLE_MOTION] & FIRST_FRAME) != 0:
        watch_motion(ecu, cal)
    ecu.detected = ecu.detected | (ecu.clock_off << FAULT_SAMPLE_RATE_OFF)


def init_samples(ecu: Ecu) -> None:
    """Start as after a break in reception."""
    ecu.sample_gap[UNIT] = AGE_MAX
