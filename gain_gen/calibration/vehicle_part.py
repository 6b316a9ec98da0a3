"""Calibration fields from the vehicle: limits, split, schedule, supervision."""

from math import ceil, exp, floor, log2, sqrt

import numpy as np

from canroll import dbc
from canroll.firmware import calibration as fw
from canroll.firmware.state import (
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_ROLL_REFERENCE,
    RX_SUSPENSION_RATE,
    RX_VEHICLE_MOTION,
)
from canroll.gain_gen.calibration.monitor_part import monitor_fields
from canroll.gain_gen.calibration.rows import quantise, quantise_row
from canroll.gain_gen.models.controller import SPEEDS
from canroll.gain_gen.models.front_share import front_share
from canroll.gain_gen.models.task import PERIODS, Task
from canroll.gain_gen.monitors.bank import weight
from canroll.gain_gen.monitors.uncertainty import Uncertainty
from canroll.vehicles import Vehicle
from canroll.vehicles.actuators import ACTUATORS, MILLI
from canroll.vehicles.axles import axles
from canroll.vehicles.model import GRAVITY, SemiActiveDampers

MISSED_SAMPLES = 5
KMH = 1.0 / 3.6
FADE = (5.0 * KMH, 10.0 * KMH)
RAMP = 0.2
"""In which the law comes on, s."""
BRAKING = 1.2 * GRAVITY
"""What brakes on dry asphalt may take from the speed, m/s²."""
DEVIATIONS = 8.0
"""Standard deviations that no sample leaves: one of 10¹⁵."""
LATERAL_TIME = 0.1
"""In which a car may lose or build up all that its tyres bear sideways, s.

The quickest simulated, fishhooks on tyres that bear g, change 1.6 m/s² in 0.01 s, 8.7 m/s² in 0.1.
"""
OUTWARD_SHARE = 0.2
OUTWARD_LATERAL = 2.0
OUTWARD_TIME = 0.1
OUTWARD_FALL = 0.16
"""Safety envelope: share of the moment limit, m/s², s, and time constant of the low-pass, s."""
LEARNING = 2.0**-8
"""Of the error to the sensors' offsets in 10 ms: they are learnt in 2.6 s."""
IDENTIFICATION_UNIT = 100.0
"""Least unit of the identification's equation, N·m·s."""
LINEAR_SHARE = 0.7
"""Lateral acceleration over friction × g up to which the tyres follow the steering, about.

Beyond, as in a fishhook, the angle would promise what they cannot hold.
"""

Value = int | list[int] | list[list[int]]


def vehicle_fields(task: Task, schedule: tuple[float, ...], box: Uncertainty) -> dict[str, Value]:
    """Return the fields determined by the vehicle, its actuators and the tick.

    Args:
        task: task of the design.
        schedule: factor on the command at each of :data:`SPEEDS`.
        box: what is not known of the car.
    """
    share = share_of(task)
    share_of_error = np.array([weight(LEARNING, task.sample(RX_IMU))])
    # an error takes 32 bits
    learning = quantise_row(share_of_error, (0,), 0, name="offset_gain", bound=1 << 31)
    return (
        _supervision(task)
        | _identification(task)
        | _limits(task, share)
        | _schedule(task.vehicle, share, schedule)
        | _allocation(task)
        | _envelope(task, share)
        | monitor_fields(task, box)
        | {
            "straight_steering": _q(0.03, 24),
            "straight_yaw_rate": _q(0.01, fw.Q_RATE),
            "offset_gain": learning.stored[0],
            "offset_shift": learning.shift,
            "offset_rate_max": _q(0.035, fw.Q_RATE),
            "offset_acceleration_max": _q(0.5, fw.Q_ACCELERATION),
        }
    )


def share_of(task: Task) -> float:
    """Return the front axle's share of the moment; for printed gains it is l_r / l."""
    if task.gains == "as_printed":
        return task.vehicle.geometry.static_front_share
    return front_share(task.vehicle)


def moment_limit(task: Task, share: float) -> float:
    """Return the largest command: the moment available from the actuators at this split, N·m.

    Valves are commanded by currents, one per axle, in mA.
    """
    return ACTUATORS[task.actuator].command_limit(task.vehicle, share, _range)


def actuator_moment(task: Task) -> float:
    """Return the largest roll moment of the actuators at this split, N·m."""
    return ACTUATORS[task.actuator].moment_limit(task.vehicle, share_of(task), _range)


def _range(message: str, signal: str) -> int:
    """Return the range of a command on the bus, whole N, N·m or mA."""
    return floor(dbc.largest(message, signal))


def _q(value: float, q: int) -> int:
    return round(value * 2.0**q)


def timeouts(task: Task, *others: int) -> list[int]:
    """Return timeouts of five samples for the messages that the loop and ``others`` need, ticks."""
    needed = {RX_IMU, RX_VEHICLE_MOTION, RX_ACTUATOR_STATE, *others}
    if ACTUATORS[task.actuator].needs_suspension_rate:
        needed.add(RX_SUSPENSION_RATE)
    if task.observer == "reference":
        needed = needed - {RX_IMU} | {RX_ROLL_REFERENCE}
    samples = [max(period, task.tick) for period in PERIODS]
    return [
        ceil(MISSED_SAMPLES * sample / task.tick + task.delay.most / task.tick)
        if message in needed
        else 0
        for message, sample in enumerate(samples)
    ]


def release_time(task: Task) -> float:
    """Return the time (s) in which a moment fades that is taken away: a period of the roll.

    A valve's current is the rate of a moment: without it the moment stays.
    """
    return RAMP if task.actuator == "valves" else task.vehicle.design.roll_period


def _supervision(task: Task) -> dict[str, Value]:
    """Timeouts, E2E tolerance, ramps."""
    return {
        "timeout_ticks": timeouts(task),
        "e2e_max_delta": [3] * fw.N_RX,
        "e2e_max_repeated": [14] * fw.N_RX,
        "e2e_sync": [1] * fw.N_RX,
        "init_ticks": ceil(0.2 / task.tick),
        "recovery_ticks": ceil(0.5 / task.tick),
        "ramp_ticks": ceil(RAMP / task.tick),
        "release_ticks": ceil(release_time(task) / task.tick),
        "stuck_ticks": ceil(0.2 / task.tick),
        "roll_rate_max": _q(min(task.vehicle.sensors.roll_rate.range, 7.9), fw.Q_RATE),
        "acceleration_max": _q(
            min(task.vehicle.sensors.lateral_acceleration.range, 40.0), fw.Q_ACCELERATION
        ),
        "acceleration_change": _q(_lateral_rate(task) * task.tick, fw.Q_ACCELERATION),
        "acceleration_noise": _q(_acceleration_noise(task), fw.Q_ACCELERATION),
        "speed_fall": _q(BRAKING * task.tick, fw.Q_SPEED),
        "speed_noise": _q(_speed_noise(task), fw.Q_SPEED),
    }


def _speed_noise(task: Task) -> float:
    """Return what two samples of the speed may differ by besides braking: noise, and their ages."""
    noise = sqrt(2.0) * task.vehicle.sensors.speed.deviation
    return DEVIATIONS * noise + BRAKING * (task.delay.most + task.periods[RX_VEHICLE_MOTION])


def _lateral_rate(task: Task) -> float:
    """Return the most that the lateral acceleration changes by for long, m/s³."""
    return task.vehicle.tyre.friction * GRAVITY / LATERAL_TIME


def _acceleration_noise(task: Task) -> float:
    """Likewise of the lateral acceleration: ticks find samples between new and a period old."""
    noise = sqrt(2.0) * task.vehicle.sensors.lateral_acceleration.deviation
    return DEVIATIONS * noise + _lateral_rate(task) * task.periods[RX_IMU]


def _identification_unit(inertia: float) -> float:
    """Return the unit of the least squares, N·m·s: 100, doubled until the inertia fits its field.

    All four coefficients of the equation are divided by it, so that its ratios do not depend on it.
    """
    field = fw.COEFFICIENT / 2**30
    ratio = inertia / IDENTIFICATION_UNIT * 2.0 ** (20 - fw.Q_RATE) / field
    return IDENTIFICATION_UNIT * 2.0 ** max(0, ceil(log2(ratio)))


def _identification(task: Task) -> dict[str, Value]:
    """Least squares of stiffness and damping: Yim 2020, section III.D, integral form."""
    roll = task.vehicle.design
    step_ticks = max(1, min(20, round(0.01 / task.tick)))
    step = step_ticks * task.tick
    stiffness = roll.effective_stiffness
    unit = _identification_unit(roll.roll_inertia)
    forgetting = 0.998 ** (step / 0.01)

    def q30(value: float, name: str) -> int:
        return quantise(value, 30, 0, fw.COEFFICIENT, name=name)

    return {
        "rls_forgetting": _q(forgetting, 30),
        "rls_washout": _q(0.99 ** (step / 0.01), 30),
        "rls_gate": _q(0.045, fw.Q_RATE),
        "rls_trace_max": 20 << 20,
        "rls_start": 8 << 20,
        "rls_lo": [_q(0.5, 28), _q(0.4, 28)],
        "rls_hi": [_q(1.6, 28), _q(2.0, 28)],
        "rls_decimation": step_ticks,
        "rls_moment": q30(step / unit * 2.0 ** (20 - fw.Q_MOMENT), "rls_moment"),
        "rls_lateral": q30(
            roll.roll_arm * step / unit * 2.0 ** (20 - fw.Q_ACCELERATION), "rls_lateral"
        ),
        "rls_inertia": q30(roll.roll_inertia / unit * 2.0 ** (20 - fw.Q_RATE), "rls_inertia"),
        "rls_stiffness": q30(stiffness * step / unit * 2.0 ** (20 - fw.Q_ANGLE), "rls_stiffness"),
        "rls_damping": quantise(
            roll.roll_damping / (stiffness * step), 20, 0, fw.COEFFICIENT, name="rls_damping"
        ),
        "model_stiffness": q30(stiffness * task.tick**2 / roll.roll_inertia, "model_stiffness"),
        "model_damping": q30(roll.roll_damping * task.tick / roll.roll_inertia, "model_damping"),
    }


def _limits(task: Task, share: float) -> dict[str, int]:
    """Limits of the moment, of its slew and of the lateral acceleration by steering."""
    limit = moment_limit(task, share)
    actuator = ACTUATORS[task.actuator]
    slew = actuator.command_rate(task.vehicle, share, _range, task.tick) * task.tick
    followed = LINEAR_SHARE * task.vehicle.tyre.friction * GRAVITY
    return {
        "moment_max": quantise(limit, fw.Q_MOMENT, 0, fw.STATE_MAX, name="moment_max"),
        "slew_max": max(1, min(_q(slew, fw.Q_MOMENT), fw.STATE_MAX)),
        "steering_limit": _q(followed, fw.Q_ACCELERATION),
    }


def _envelope(task: Task, share: float) -> dict[str, Value]:
    """Safety envelope: what the law may at most, and what pushes outward no longer than 0.1 s.

    The largest change is that of the slew limit, or of the ramp to zero in SAFE if that is more.
    In fault-free severe manoeuvres no law pushes outward by a fifth of its limit for longer than
    0.03 s while the lateral acceleration is above 2 m/s² and does not fall.
    """
    limits = _limits(task, share)
    most, slew, ramp = limits["moment_max"], limits["slew_max"], ceil(RAMP / task.tick)
    source = RX_ROLL_REFERENCE if task.observer == "reference" else RX_IMU
    release = ceil(release_time(task) / task.tick)
    return {
        "envelope_moment": most,
        "envelope_slew": min(max(slew, most // ramp + 2), fw.STATE_MAX),
        "envelope_age": timeouts(task)[source] + 2 * release,
        "envelope_outward": round(OUTWARD_SHARE * _q(actuator_moment(task), fw.Q_MOMENT)),
        "envelope_lateral": _q(OUTWARD_LATERAL, fw.Q_ACCELERATION),
        "envelope_ticks": ceil(OUTWARD_TIME / task.tick),
        "envelope_pass": _q(1.0 - exp(-task.tick / OUTWARD_FALL), fw.Q_UNIT),
    }


def _schedule(vehicle: Vehicle, share: float, factors: tuple[float, ...]) -> dict[str, Value]:
    """Schedule over speed: factor on the command, lateral acceleration from steering, fading."""
    points = fw.N_POINTS
    return {
        "schedule_points": points,
        "schedule_speed": [_q(speed, fw.Q_SPEED) for speed in SPEEDS],
        "schedule_gain": [_q(factor, 28) for factor in factors],
        "schedule_front_share": [_q(share, fw.Q_UNIT)] * points,
        "schedule_steering": [
            quantise(
                vehicle.lateral_gain(speed) / vehicle.steering.ratio,
                20,
                -fw.STATE_MAX,
                fw.STATE_MAX,
                name="schedule_steering",
            )
            for speed in SPEEDS
        ],
        "fade_low": _q(FADE[0], fw.Q_SPEED),
        "fade_high": _q(FADE[1], fw.Q_SPEED),
    }


def damper_knee(dampers: SemiActiveDampers, force: tuple[float, ...]) -> tuple[float, float, float]:
    """Return speed, force at the knee and slope beyond it of one damper curve: m/s, N, N·s/m."""
    rate = np.array(dampers.rate[1:])
    secant = np.array(force[1:]) / rate
    straight = np.flatnonzero(secant >= 0.999 * secant[0])
    knee = int(straight[-1])
    speed, at = float(rate[knee]), float(force[1 + knee])
    beyond = (force[-1] - at) / (rate[-1] - speed) if rate[-1] > speed else 0.0
    return speed, at, float(beyond)


def _allocation(task: Task) -> dict[str, Value]:
    """Geometry of the split and limits of each actuator."""
    actuators = task.vehicle.actuators
    current = ACTUATORS[task.actuator].current_limit(task.vehicle)
    front, rear = (2.0 * axle.half_track for axle in axles(task.vehicle))
    ranges = {
        name: _range(*ACTUATORS[name].commands[0][:2]) for name in ("suspension", "bars", "valves")
    }
    force = min(actuators.suspension.force_limit, ranges["suspension"])
    bar = min(actuators.bars.torque_limit, ranges["bars"])
    most = {name: largest << fw.Q_MOMENT for name, largest in ranges.items()}
    soft = damper_knee(actuators.dampers, actuators.dampers.soft_force)
    firm = damper_knee(actuators.dampers, actuators.dampers.firm_force)
    return {
        "arm_front": _q(1.0 / front, 28),
        "arm_rear": _q(1.0 / rear, 28),
        "track_front": _q(front, 28),
        "track_rear": _q(rear, 28),
        "force_max": [quantise(force, fw.Q_MOMENT, 0, most["suspension"], name="force_max")] * 4,
        "share_slack": _q(0.1, fw.Q_UNIT),
        "bar_max": [quantise(bar, fw.Q_MOMENT, 0, most["bars"], name="bar_max")] * 2,
        "damper_speed": [_q(soft[0], fw.Q_RATE), _q(firm[0], fw.Q_RATE)],
        "damper_force": [_q(soft[1], fw.Q_MOMENT), _q(firm[1], fw.Q_MOMENT)],
        "damper_slope": [_q(soft[2], fw.Q_MOMENT), _q(firm[2], fw.Q_MOMENT)],
        "current_max": _q(min(MILLI * current, ranges["valves"]), fw.Q_MOMENT),
    }
