"""Calibration of the monitors of sensors and actuators.

Thresholds come from fault-free runs of six vehicles and their populations up to the limit
(``tools/validation/false_alarms.py``); docs/detection.md has the margins.
"""

from math import ceil, pi

import dbc
from firmware import calibration as fw
from gain_gen.calibration.rows import quantise
from gain_gen.laws import WITHOUT_ROLL_RATE
from gain_gen.models.task import Task
from vehicles import Vehicle
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
CLOCK_WINDOW = 2.0
"""Time over which the inertial unit's samples are counted, s."""
CLOCK = 0.04
"""By which they may differ from the ECU's ticks, s: 2 % of the window, and all that the time of a
frame on the bus may vary by."""
ERRATIC = 0.4, 8.0, 0.09, 1.0, 0.7
"""Largest second difference of samples 10 ms (inertial unit) and 20 ms (speed, steering) apart:
roll rate, rad/s; lateral acceleration, m/s², which reaches 4.1 on a rough road (class C); yaw rate,
rad/s; speed, m/s; steering-wheel angle, rad."""
ROLLING = 0.06
"""Distance of the roll rate from those of both suspensions, besides a quarter of the larger one,
rad/s."""
ROLLING_TIME = 0.05
"""How long without a break, s."""
RESPONSE_LEAST = 0.4
"""Residual always tolerated: the roll moment m h a_y of this lateral acceleration, m/s²."""
RESPONSE_LINEAR = 10.0
"""Lateral acceleration by yaw rate or steering, m/s², beyond which wheels lift and stops are
reached."""
RESPONSE_TIME = 0.18
"""Time for which residuals of the lateral acceleration and of the axles exceed their limit, s;
of the body to one side five eighths as long."""
RESPONSE_LOW_PASS = 0.05
"""Time constant of the low-pass, s."""
RESPONSE_WASHOUT = 0.2
"""Corner of the washout, Hz."""
AXLES_LEAST = 0.0012
"""Residual always tolerated between the axles, as roll of the front tyres, rad."""
AXLES_ROUGH = 0.035
"""What a rough road may leave over: roll in this time at the rate at which the axles' suspensions
move apart, s."""
AXLES_REST = 0.003
"""The axles are not judged where a rough road and wrong moments may leave over more, rad."""
AXLES_LINEAR = 7.0
"""Lateral acceleration by yaw rate or steering, m/s², up to which wheels stay on the road: neither
axles nor roll rates are compared above."""

HEAVE_LEAST = 0.9
"""What the springs may carry more or less, by mass of the body, m/s²: equals a crest of 350 m
radius at 64 km/h."""
HEAVE_TIME = 1.0
"""How long without a break, s."""


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
    by the steady roll at the largest lateral acceleration that is judged.
    """
    roll = vehicle.design
    swing = roll.natural_frequency * roll.roll_arm * RESPONSE_LINEAR / roll.effective_stiffness
    largest = max(roll.roll_arm * RESPONSE_LINEAR, roll.roll_inertia * swing / RESPONSE_LOW_PASS)
    limit = fw.STATE_MAX * 2.0**-fw.Q_MOMENT
    if largest <= limit:
        return ""
    return (
        f"the moments of a body with design.roll_inertia {roll.roll_inertia:g} kg·m² reach "
        f"{1e-3 * largest:.0f} kN·m in the balance, above the {1e-3 * limit:.1f} kN·m of its "
        "fixed-point format"
    )


def response_fields(task: Task) -> dict[str, int | list[int]]:
    """Return the fields of the monitors by the suspension, of bars or of corner forces.

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
        "rolling_min": round(ROLLING * 2.0**fw.Q_RATE),
        "rolling_ticks": max(2, round(ROLLING_TIME / task.tick)),
        "rolling_track": [
            quantise(1.0 / track, 28, 0, 4 << 28, name="rolling_track") for track in tracks
        ],
        "rolling_tyres": quantise(
            4.0 / (RESPONSE_LOW_PASS * sum(_tyre_roll_stiffness(vehicle))),
            30,
            0,
            fw.ONE,
            name="rolling_tyres",
        ),
        "response_min": round(RESPONSE_LEAST * roll.roll_arm * 2.0**fw.Q_MOMENT),
        "response_limit": round(RESPONSE_LINEAR * 2.0**fw.Q_ACCELERATION),
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
        **_axles_fields(task),
        **_heave_fields(task),
    }


def _tyre_roll_stiffness(vehicle: Vehicle) -> list[float]:
    """Return the roll stiffness of both axles' tyres, N·m/rad."""
    halves = vehicle.geometry.half_track_front, vehicle.geometry.half_track_rear
    return [2.0 * vehicle.tyre.vertical_stiffness * half**2 for half in halves]


def _axles_fields(task: Task) -> dict[str, int | list[int]]:
    """Return the fields of the axles monitor: moments of the rear as of the front axle's tyres."""
    vehicle = task.vehicle
    geometry, mass = vehicle.geometry, vehicle.mass
    halves = geometry.half_track_front, geometry.half_track_rear
    heights = geometry.roll_centre_height_front, geometry.roll_centre_height_rear
    tyres = _tyre_roll_stiffness(vehicle)
    scale = 1.0, tyres[0] / tyres[1]
    spring = suspension_roll_stiffness(vehicle)
    springs = [
        factor * (share * spring + tyre)
        for factor, share, tyre in zip(scale, axle_roll_shares(vehicle), tyres, strict=True)
    ]
    front_share = vehicle.suspension.roll_damping_front_share
    damping = vehicle.design.roll_damping * (front_share + scale[1] * (1.0 - front_share))
    distances = geometry.cg_to_rear_axle, geometry.cg_to_front_axle
    lateral = []
    for other, height, unsprung in zip(
        distances, heights, (mass.unsprung_front, mass.unsprung_rear), strict=True
    ):
        sprung = vehicle.total_mass * other / geometry.wheelbase - unsprung
        lateral.append(sprung * height + unsprung * vehicle.tyre.radius)
    arm = (heights[0] + scale[1] * heights[1]) / geometry.wheelbase

    def coefficient(value: float, name: str) -> int:
        return quantise(value, 10, -fw.COEFFICIENT, fw.COEFFICIENT, name=name)

    return {
        "axles_min": round(AXLES_LEAST * tyres[0] * 2.0**fw.Q_MOMENT),
        "axles_rest": round(AXLES_REST * tyres[0] * 2.0**fw.Q_MOMENT),
        "axles_limit": round(AXLES_LINEAR * 2.0**fw.Q_ACCELERATION),
        "axles_stretch": [
            coefficient(task.tick * stiffness / (2.0 * half), "axles_stretch")
            for stiffness, half in zip(springs, halves, strict=True)
        ],
        "axles_damping": coefficient(damping / sum(springs) / task.tick, "axles_damping"),
        "axles_rough": coefficient(AXLES_ROUGH / task.tick, "axles_rough"),
        "axles_rear": quantise(scale[1], 28, 0, 4 << 28, name="axles_rear"),
        "axles_lateral": coefficient(lateral[0] - scale[1] * lateral[1], "axles_lateral"),
        "axles_yaw": coefficient(arm * mass.yaw_inertia / RESPONSE_LOW_PASS, "axles_yaw"),
    }


def _heave_fields(task: Task) -> dict[str, int | list[int]]:
    """Return the fields of the heave monitor, of corner forces alone: a bar lifts nothing."""
    suspension = task.vehicle.suspension
    least = HEAVE_LEAST * task.vehicle.design.sprung_mass if task.actuator == "suspension" else 0.0
    return {
        "heave_min": round(least * 2.0**fw.Q_MOMENT),
        "heave_ticks": max(2, round(HEAVE_TIME / task.tick)),
        "heave_stretch": [
            quantise(task.tick * rate, 10, 0, fw.COEFFICIENT, name="heave_stretch")
            for rate in (suspension.spring_rate_front, suspension.spring_rate_rear)
        ],
    }
