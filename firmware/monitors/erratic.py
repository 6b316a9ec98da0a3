"""Erratic sensors: samples that jump as no car can move, and noise beyond the sensor's own.

From sample to sample a car's motion bends little: the second difference is small, whatever the
manoeuvre, and a steady change has none. Squared in units of the largest that may be, it is summed
up over a window that forgets a share with each sample: the sum exceeds one soon after a jump and
while a signal is noisy. It is reported until the sum has faded, and changes no mode: a jump may be
a spike, and what wrong values do is judged by the other monitors.

A signal without a valid value starts anew, and so do all of a message where samples are missing:
those of a car that turns are far apart. So do those of a further frame without a new sample.
"""

from firmware.calibration import Calibration
from firmware.plausibility import FAULT_SENSOR_ERRATIC
from firmware.state import FIRST_FRAME, RX_IMU, RX_VEHICLE_MOTION, Ecu
from firmware.subset import byte, clamp, i32, rsh, sat31

# messages
UNIT = 0
MOTION = 1
# samples in a row from which a second difference is known
KNOWN = 3
# the largest second difference that may be, squared; none counts as more than four of them
ONE_SQUARE = 1 << 12
MOST = 1 << 14
GAP_MAX = 255


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


def samples_known(ecu: Ecu, cal: Calibration, group: i32, sample: i32) -> i32:
    """Return how many samples of a message may be known with its newest: 1 if one is missing."""
    gap: i32 = ecu.erratic_gap[group]
    step: i32 = (sample - ecu.erratic_sample[group]) & 15
    ecu.erratic_gap[group] = 0
    ecu.erratic_sample[group] = byte(sample)
    if gap > cal.erratic_gap[group] or step != cal.erratic_samples[group]:
        return 1
    return KNOWN


def watch_unit(ecu: Ecu, cal: Calibration) -> None:
    """Judge the newest samples of the inertial unit."""
    valid: i32 = ecu.valid[RX_IMU] & ecu.fresh[RX_IMU]
    known: i32 = samples_known(ecu, cal, UNIT, ecu.imu_sample)
    watch_signal(ecu, cal, 0, ecu.roll_rate, known * (valid & 1))
    watch_signal(ecu, cal, 1, ecu.lateral_acceleration, known * ((valid >> 1) & 1))
    watch_signal(ecu, cal, 2, ecu.yaw_rate, known * ((valid >> 2) & 1))


def watch_motion(ecu: Ecu, cal: Calibration) -> None:
    """Judge the newest samples of speed and steering angle."""
    valid: i32 = ecu.valid[RX_VEHICLE_MOTION] & ecu.fresh[RX_VEHICLE_MOTION]
    known: i32 = samples_known(ecu, cal, MOTION, ecu.motion_sample)
    watch_signal(ecu, cal, 3, ecu.speed, known * (valid & 1))
    watch_signal(ecu, cal, 4, ecu.steering, known * ((valid >> 1) & 1))


def watch_erratic(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Judge the newest samples of motion and driver."""
    for group in range(2):
        ecu.erratic_gap[group] = byte(clamp(ecu.erratic_gap[group] + elapsed, 0, GAP_MAX))
    if (ecu.fresh[RX_IMU] & FIRST_FRAME) != 0:
        watch_unit(ecu, cal)
    if (ecu.fresh[RX_VEHICLE_MOTION] & FIRST_FRAME) != 0:
        watch_motion(ecu, cal)
