"""Calibration of the monitors of sensors and of delivered moments.

What signals may differ by for what is not known of the car follows from that
(:mod:`canroll.gain_gen.monitors`). The other thresholds come from fault-free runs of six vehicles
and their populations up to the limit, measured with version 0.2.
"""

from math import ceil

from canroll.firmware import calibration as fw
from canroll.firmware.state import RX_ACTUATOR_STATE, RX_IMU, RX_VEHICLE_MOTION
from canroll.gain_gen.calibration.rows import quantise, shares
from canroll.gain_gen.laws import WITHOUT_ROLL_RATE
from canroll.gain_gen.models.task import PERIODS, Task
from canroll.gain_gen.monitors.bank import TRUST, weight
from canroll.gain_gen.monitors.residuals import LATERAL_TIME, LINEAR, lateral_gap
from canroll.gain_gen.monitors.uncertainty import Uncertainty

FADING = TRUST, 2.0**-7
"""By which the largest motion fades in 10 ms: in 20 s, and for the distance expected in 1.3 s."""
MIRROR_PASS = 1 / 8, 1 / 16
"""Low-passes of the mirror image: weights for 10 ms, of steering in 0.08 s and a mean of 0.16 s."""
OPPOSITE = 1.5
"""Magnitude of lateral acceleration and of yaw rate times speed that may not oppose, m/s²."""
BOUND_TIME = 0.1
"""How long the gyro bias may be at its bound without a break, s."""
MIRROR_LINEAR = 10.0
"""Lateral acceleration by yaw rate or steering, m/s², up to which a mirror image is judged."""
MIRROR = 0.5
"""By how much nearer to the negative of the steering's lateral acceleration than to it, m/s²."""
EDGE_SHARE = 0.05
EDGE = 150.0
"""Least width of the edges of a band of commands: share of an axle's largest moment, and N·m."""
LAGS = 0.05
"""Time by which a window exceeds the largest delay from sample to force, s: lag and way back."""
DELIVERY_SAMPLES = 4
"""Samples in a row outside the band before an axle counts as failed."""
CLOCK_WINDOW = 2.0
"""Time over which the inertial unit's samples are counted, s."""
CLOCK = 0.04
"""By which they may differ from the ECU's ticks, s: 2 % of the window, and all that the time of a
frame on the bus may vary by."""
ERRATIC_KEPT = 7 / 8
"""Of the sum of squared second differences, from one sample to the next, as often as these."""
ERRATIC = 0.4, 8.0, 0.09, 1.0, 0.7
"""Largest second difference of samples 10 ms (inertial unit) and 20 ms (speed, steering) apart:
roll rate, rad/s; lateral acceleration, m/s², which reaches 4.1 on a rough road (class C); yaw rate,
rad/s; speed, m/s; steering-wheel angle, rad."""


def monitor_fields(task: Task, box: Uncertainty) -> dict[str, int | list[int]]:
    """Return the fields of the monitors, for what is not known of the car.

    The moments are watched where the commands are moments, the sensors where the observer uses
    them.
    """
    imu = task.sample(RX_IMU)
    state = task.sample(RX_ACTUATOR_STATE)
    moment = _axle_moment(task)
    edge = EDGE + EDGE_SHARE * moment if moment else 0.0
    gap, share = lateral_gap(task.vehicle, box, task.tick)
    if task.observer == "reference":
        gap = 0.0
    # a car comes back from no larger slide than its front wheels can be steered against
    lock = task.vehicle.steering.angle_limit
    return {
        "redundancy_min": round(gap * 2.0**fw.Q_ACCELERATION),
        "redundancy_share": shares([share], "redundancy_share")[0],
        "redundancy_limit": round(LINEAR * 2.0**fw.Q_ACCELERATION),
        "redundancy_pass": [
            round(weight(of_10_ms, imu) * fw.ONE) for of_10_ms in (*FADING, *MIRROR_PASS)
        ],
        "opposite_min": round(OPPOSITE * 2.0**fw.Q_ACCELERATION),
        "slide_max": quantise(lock / imu, fw.Q_SLIDE, 0, fw.STATE_MAX, name="slide_max"),
        "apart_samples": max(2, round(LATERAL_TIME / imu)),
        "bound_samples": max(2, round(BOUND_TIME / imu)),
        "mirror_limit": round(MIRROR_LINEAR * 2.0**fw.Q_ACCELERATION),
        "mirror_min": round(MIRROR * 2.0**fw.Q_ACCELERATION),
        "delivery_window": min(ceil((task.delay.most + LAGS) / state), 1000),
        "delivery_samples": DELIVERY_SAMPLES,
        "delivery_min": round(edge * 2.0**fw.Q_MOMENT),
        "delivery_share": shares([box.moment], "delivery_share")[0],
    }


def clock_fields(task: Task, period: float) -> dict[str, int | list[int]]:
    """Return the fields of the clock monitor, for samples that count ``period`` s; 0: it is off."""
    return {
        "clock_period": round(1e6 * period),
        "clock_limit": round(1e6 * CLOCK),
        "clock_window": max(2, round(CLOCK_WINDOW / task.tick)),
    }


def erratic_fields(task: Task) -> dict[str, int | list[int]]:
    """Return the fields of the erratic monitor; a slower loop sees more bend of its samples."""
    messages = RX_IMU, RX_VEHICLE_MOTION
    periods = [task.periods[message] for message in messages]
    longer = [task.sample(message) / PERIODS[message] for message in messages]
    formats = fw.Q_RATE, fw.Q_ACCELERATION, fw.Q_RATE, fw.Q_SPEED, 24
    scales = [
        round(2.0 ** (42 - q) / (most * max(1.0, longer[k > 2]) ** 2))
        for k, (most, q) in enumerate(zip(ERRATIC, formats, strict=True))
    ]
    if task.observer in WITHOUT_ROLL_RATE:
        scales[0] = 0
    return {
        "erratic_scale": [0] * len(scales) if task.observer == "reference" else scales,
        "erratic_kept": [round(ERRATIC_KEPT ** longer[k > 2] * fw.ONE) for k in range(len(scales))],
        "erratic_samples": [max(1, round(task.tick / period)) for period in periods],
        "erratic_gap": [max(1, round(period / task.tick)) for period in periods],
    }


def _axle_moment(task: Task) -> float:
    """Return the largest moment of an axle, N·m; 0 where commands are not moments."""
    actuators, geometry = task.vehicle.actuators, task.vehicle.geometry
    if task.actuator == "suspension":
        track = 2.0 * max(geometry.half_track_front, geometry.half_track_rear)
        return track * actuators.suspension.force_limit
    return actuators.bars.torque_limit if task.actuator == "bars" else 0.0
