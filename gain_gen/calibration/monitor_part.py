"""Calibration of the monitors of sensors and actuators.

Thresholds come from fault-free runs of six vehicles and their populations up to the limit
(``tools/validation/false_alarms.py``); docs/detection.md has the margins.
"""

from math import ceil, pi

import dbc
from firmware import calibration as fw
from gain_gen.calibration.rows import quantise
from gain_gen.models.task import Task
from vehicles.roll_stiffness import axle_roll_shares, suspension_roll_stiffness

GAP = 2.4
"""Distance of the lateral acceleration from both of the others, besides half of the larger one,
m/s²: a road banked by 10 degrees makes 1.7 m/s²."""
LINEAR = 5.0
"""End of the tyres' linear range, m/s² by yaw rate or steering."""
OPPOSITE = 1.5
"""Magnitude of lateral acceleration and of yaw rate times speed that may not oppose, m/s²."""
GAP_TIME, OPPOSITE_TIME, BOUND_TIME = 0.08, 0.6, 0.1
"""How long without a break, s: outside both others, of opposite sign, gyro bias at its bound."""
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
RESPONSE_LEAST = 1.4
"""What may always be left over: the roll moment m h a_y of this lateral acceleration, m/s²."""
RESPONSE_TIME = 0.2
"""How long too much is left over without a break, s."""
RESPONSE_LOW_PASS = 0.05
"""Time constant of the low-pass, s."""
RESPONSE_WASHOUT = 0.2
"""Corner of the washout, Hz."""


def monitor_fields(task: Task) -> dict[str, int | list[int]]:
    """Return the fields of the monitors.

    The moments are watched where the commands are moments, the sensors where the observer uses
    them.
    """
    imu = max(dbc.period("Imu"), task.tick)
    state = max(dbc.period("ActuatorState"), task.tick)
    moment = _axle_moment(task)
    edge = EDGE + EDGE_SHARE * moment if moment else 0.0
    gap = 0.0 if task.observer == "reference" else GAP
    return {
        "redundancy_min": round(gap * 2.0**fw.Q_ACCELERATION),
        "redundancy_limit": round(LINEAR * 2.0**fw.Q_ACCELERATION),
        "opposite_min": round(OPPOSITE * 2.0**fw.Q_ACCELERATION),
        "apart_samples": max(2, round(GAP_TIME / imu)),
        "opposite_samples": max(2, round(OPPOSITE_TIME / imu)),
        "bound_samples": max(2, round(BOUND_TIME / imu)),
        "mirror_limit": round(MIRROR_LINEAR * 2.0**fw.Q_ACCELERATION),
        "mirror_min": round(MIRROR * 2.0**fw.Q_ACCELERATION),
        "delivery_window": min(ceil((task.delay.most + LAGS) / state), 1000),
        "delivery_samples": DELIVERY_SAMPLES,
        "delivery_min": round(edge * 2.0**fw.Q_MOMENT),
    }


def _axle_moment(task: Task) -> float:
    """Return the largest moment of an axle, N·m; 0 where commands are not moments."""
    actuators, geometry = task.vehicle.actuators, task.vehicle.geometry
    if task.actuator == "suspension":
        track = 2.0 * max(geometry.half_track_front, geometry.half_track_rear)
        return track * actuators.suspension.force_limit
    return actuators.bars.torque_limit if task.actuator == "bars" else 0.0


def response_fields(task: Task) -> dict[str, int | list[int]]:
    """Return the fields of the response monitor, of bars or of corner forces.

    Springs and dampers of both axles count by the springs' shares, with one time constant.

    Raises:
        CanrollError: a coefficient is outside its field's range; the message names it.
    """
    vehicle, roll = task.vehicle, task.vehicle.design
    stiffness = suspension_roll_stiffness(vehicle)
    tracks = 2.0 * vehicle.geometry.half_track_front, 2.0 * vehicle.geometry.half_track_rear

    def coefficient(value: float, name: str) -> int:
        return quantise(value, 10, 0, fw.COEFFICIENT, name=name)

    return {
        "response_min": round(RESPONSE_LEAST * roll.roll_arm * 2.0**fw.Q_MOMENT),
        "response_ticks": max(2, round(RESPONSE_TIME / task.tick)),
        "response_stroke": [
            coefficient(share * roll.roll_damping / track, "response_stroke")
            for share, track in zip(axle_roll_shares(vehicle), tracks, strict=True)
        ],
        "response_stretch": quantise(
            task.tick * stiffness / roll.roll_damping, 30, 0, fw.ONE, name="response_stretch"
        ),
        "response_lateral": coefficient(roll.roll_arm, "response_lateral"),
        "response_inertia": coefficient(roll.roll_inertia / RESPONSE_LOW_PASS, "response_inertia"),
        "response_pass": round(task.tick / RESPONSE_LOW_PASS * fw.ONE),
        "response_wash": round(2.0 * pi * RESPONSE_WASHOUT * task.tick * fw.ONE),
    }
