"""Calibration of the monitors that judge one signal or one command by itself.

Their thresholds come from fault-free runs (``tools/validation/false_alarms.py``); those of the
residuals are computed (:mod:`gain_gen.monitors`).
"""

from math import ceil

import dbc
from firmware import calibration as fw
from gain_gen.calibration.rows import quantise
from gain_gen.laws import WITHOUT_ROLL_RATE
from gain_gen.models.task import Task
from gain_gen.monitors.residuals import LOW_PASS
from vehicles import GRAVITY, Vehicle

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
ERRATIC = 0.4, 8.0, 0.09, 1.0, 0.7
"""Largest second difference of samples 10 ms (inertial unit) and 20 ms (speed, steering) apart:
roll rate, rad/s; lateral acceleration, m/s², which reaches 4.1 on a rough road (class C); yaw rate,
rad/s; speed, m/s; steering-wheel angle, rad."""
HELD = 1.5, 0.06
"""By which the others have moved while a signal stood still: lateral acceleration by yaw rate ×
speed, m/s², roll rate by both suspensions, rad/s."""
HELD_TIME = 0.08, 0.05
"""How long without a break, s."""


def monitor_fields(task: Task) -> dict[str, int | list[int]]:
    """Return the fields of delivery, mirror and held signals.

    The moments are watched where the commands are moments, the sensors where the observer uses
    them.
    """
    imu = max(dbc.period("Imu"), task.tick)
    state = max(dbc.period("ActuatorState"), task.tick)
    moment = _axle_moment(task)
    edge = EDGE + EDGE_SHARE * moment if moment else 0.0
    mirror = 0.0 if task.observer == "reference" else MIRROR
    return {
        "mirror_limit": round(MIRROR_LINEAR * 2.0**fw.Q_ACCELERATION),
        "mirror_min": round(mirror * 2.0**fw.Q_ACCELERATION),
        "held_min": [
            round(HELD[0] * 2.0**fw.Q_ACCELERATION) if mirror else fw.STATE_MAX,
            round(HELD[1] * 2.0**fw.Q_RATE),
        ],
        "held_ticks": [max(2, round(HELD_TIME[0] / imu)), max(2, round(HELD_TIME[1] / task.tick))],
        "held_roll": _held_roll(task),
        "delivery_window": min(ceil((task.delay.most + LAGS) / state), 1000),
        "delivery_samples": DELIVERY_SAMPLES,
        "delivery_min": round(edge * 2.0**fw.Q_MOMENT),
    }


def _held_roll(task: Task) -> list[int]:
    """Return roll rate over the difference of stroke rates; 0 where the roll rate is not used."""
    if task.observer == "reference" or task.observer in WITHOUT_ROLL_RATE:
        return [0, 0]
    geometry = task.vehicle.geometry
    halves = geometry.half_track_front, geometry.half_track_rear
    return [quantise(0.5 / half, 28, 0, 4 << 28, name="held_roll") for half in halves]


def clock_fields(task: Task, period: float) -> dict[str, int | list[int]]:
    """Return the fields of the clock monitor, for samples that count ``period`` s; 0: it is off."""
    return {
        "clock_period": round(1e6 * period),
        "clock_limit": round(1e6 * CLOCK),
        "clock_window": max(2, round(CLOCK_WINDOW / task.tick)),
    }


def erratic_fields(task: Task) -> dict[str, int | list[int]]:
    """Return the fields of the erratic monitor; a slower loop sees more bend of its samples."""
    periods = [dbc.period(message) for message in ("Imu", "VehicleMotion")]
    stretched = [(max(1.0, task.tick / period)) ** 2 for period in periods]
    formats = fw.Q_RATE, fw.Q_ACCELERATION, fw.Q_RATE, fw.Q_SPEED, 24
    scales = [
        round(2.0 ** (42 - q) / (most * stretched[k > 2]))
        for k, (most, q) in enumerate(zip(ERRATIC, formats, strict=True))
    ]
    if task.observer in WITHOUT_ROLL_RATE:
        scales[0] = 0
    return {
        "erratic_scale": [0] * len(scales) if task.observer == "reference" else scales,
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


def unwatched(vehicle: Vehicle) -> str:
    """Return why the moments on the body cannot be watched in fixed point; "" if they can.

    The largest is the momentum over the low-pass of a body that swings, at its natural frequency,
    by the steady roll at the largest lateral acceleration of tyres.
    """
    roll = vehicle.design
    swing = roll.natural_frequency * roll.roll_arm * GRAVITY / roll.effective_stiffness
    largest = max(roll.roll_arm * GRAVITY, roll.roll_inertia * swing / LOW_PASS)
    limit = fw.STATE_MAX * 2.0**-fw.Q_MOMENT
    if largest <= limit:
        return ""
    return (
        f"the moments of a body with design.roll_inertia {roll.roll_inertia:g} kg·m² reach "
        f"{1e-3 * largest:.0f} kN·m in the balance, above the {1e-3 * limit:.1f} kN·m of its "
        "fixed-point format"
    )
