"""Calibration of the monitors by the suspension: of moments, lateral acceleration and roll rate.

What is left over of their balances, what of it noise and the stated uncertainties explain, and for
how long: the residuals of :mod:`canroll.gain_gen.monitors.residuals`, in fixed point.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import pi

from canroll.firmware import calibration as fw
from canroll.gain_gen.calibration.rows import quantise, shares
from canroll.gain_gen.models.task import Task
from canroll.gain_gen.monitors.bank import (
    LARGEST,
    MEAN,
    RESPONSE_LINEAR,
    Residual,
    ResidualPart,
    low_pass_of,
    ticks_of,
)
from canroll.gain_gen.monitors.linear_car import car_of, effective_inertia, rolled
from canroll.gain_gen.monitors.noise import late
from canroll.gain_gen.monitors.residuals import (
    AXLES,
    FAST,
    HEAVE_TIME,
    MAY_BE_WRONG,
    SLOW,
    bank_of,
)
from canroll.gain_gen.monitors.shares import of_lateral, of_moments
from canroll.gain_gen.monitors.uncertainty import NOMINAL, Uncertainty, vertices
from canroll.vehicles import Vehicle
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness

Fields = dict[str, int | list[int]]

LIMIT_SHARE = 0.75, 0.25
"""Of what the inertia takes and of the moments besides there: chosen from runs at the limit."""
AXLES_REST = 0.003
"""The axles are not judged where a rough road and wrong moments may leave over more, rad."""


def unwatched(vehicle: Vehicle) -> str:
    """Return why the moments on the body cannot be watched in fixed point; "" if they can.

    The largest is that of the largest lateral acceleration that is judged.
    """
    largest = vehicle.design.roll_arm * RESPONSE_LINEAR
    if largest <= LARGEST:
        return ""
    return (
        f"the moments of a body with design m h = {vehicle.design.roll_arm:.0f} kg·m reach "
        f"{1e-3 * largest:.0f} kN·m in the balance, above the {1e-3 * LARGEST:.1f} kN·m of its "
        "fixed-point format"
    )


def response_fields(task: Task, box: Uncertainty) -> Fields:
    """Return the fields of the monitors by the suspension, for what is not known of the car.

    Springs and dampers of both axles count by the springs' shares, with one time constant.

    Raises:
        CanrollError: a coefficient is outside its field's range; the message names it.
    """
    # whether the roll rate is received the firmware sees; the numbers are those of a loop with it
    bank = bank_of(replace(task, observer="two_sensors"), box, suspension=True, moments=True)
    residuals = {residual.name: residual for residual in bank.residuals}
    fields = (
        _rolling(task, box, (residuals["gyro, front"], residuals["gyro, rear"]))
        | _body(task, box, *(residuals[name] for name in ("body, fast", "body, slow", "axles")))
        | _model(task.vehicle, task.tick)
        | _axles(task, box, residuals["axles"], bank.parts)
    )
    return fields | _heave(task, box, residuals.get("heave"))


def coefficient(value: float, name: str) -> int:
    """Return a coefficient with 10 fractional bits."""
    return quantise(value, 10, -fw.COEFFICIENT, fw.COEFFICIENT, name=name)


def moment(value: float) -> int:
    """Return a moment or force in its format, at most half the range."""
    return min(round(value * 2.0**fw.Q_MOMENT), fw.STATE_MAX // 2)


def acceleration(value: float) -> int:
    """Return an acceleration in its format, at most the range."""
    return min(round(value * 2.0**fw.Q_ACCELERATION), fw.STATE_MAX)


def washout(corner: float, tick: float) -> int:
    """Return the share that goes per tick with a washout's corner in Hz."""
    return round(2.0 * pi * corner * tick * fw.ONE)


def _rolling(task: Task, box: Uncertainty, gyro: tuple[Residual, Residual]) -> Fields:
    """Return the fields of the rolling monitor."""
    car = car_of(task.vehicle)
    largest = max(residual.floor for residual in gyro) / task.vehicle.design.roll_damping
    differs = max(
        abs(rolled(car, axle, factors) - 1.0)
        for axle in range(2)
        for factors in vertices(box, ("tyre", "stiffness"))
    )
    on_tyres = 1.0 / (low_pass_of(task.vehicle) * sum(car.tyres))
    return {
        "rolling_min": round(largest * 2.0**fw.Q_RATE),
        "rolling_ticks": ticks_of(gyro[0].time, task.tick),
        "rolling_track": [
            quantise(1.0 / track, 28, 0, 4 << 28, name="rolling_track") for track in car.tracks
        ],
        "rolling_share": shares([differs], "rolling_share")[0],
        "rolling_tyres": quantise(on_tyres, 30, 0, fw.ONE, name="rolling_tyres"),
    }


def _body(task: Task, box: Uncertainty, fast: Residual, slow: Residual, axles: Residual) -> Fields:
    """Return what the balances of the body may have left over, and for how long."""
    weights = {term.part.removesuffix(", fast"): term.weight for term in fast.terms}
    parts = [weights[name] for name in ("side", "springs", "dampers", "moments", "momentum")]
    parts.append(next(term.weight for term in axles.terms if term.part == "front moment"))
    roll, ticks = task.vehicle.design, ticks_of(fast.time, task.tick)
    # of the springs' change by samples that are lost, by that of the dampers' moment
    by_damping = suspension_roll_stiffness(task.vehicle) / roll.roll_damping
    return {
        "response_min": moment(fast.floor),
        "response_share": shares(parts, "response_share"),
        "response_late": [
            coefficient(by_damping * late(box, task.tick, corner), "response_late")
            for corner in (FAST, SLOW)
        ],
        "response_limit": acceleration(RESPONSE_LINEAR),
        "limit_share": shares(LIMIT_SHARE, "limit_share"),
        "response_ticks": ticks,
        "response_wash": [washout(corner, task.tick) for corner in (FAST, SLOW, AXLES)],
        # the start may be wrong by half of it: where no more is left, it is judged
        "steady_min": moment(2.0 * slow.floor),
        "steady_share": shares(of_moments(box), "steady_share"),
        "lateral_share": shares(of_lateral(box), "lateral_share"),
    }


def _model(vehicle: Vehicle, tick: float) -> Fields:
    """Return the fields of the balance of moments on the body."""
    car, roll = car_of(vehicle), vehicle.design
    suspension = vehicle.suspension
    ratio = suspension.rebound_bump_ratio
    # rebound or bump, whichever is stiffer than their mean, less its slope beyond the knee
    falls = 2.0 * max(1.0, ratio) / (ratio + 1.0) * (1.0 - suspension.high_speed_ratio)
    strokes = [
        share * roll.roll_damping / track
        for share, track in zip(car.shares, car.tracks, strict=True)
    ]
    stretch = tick * car.stiffness / roll.roll_damping
    inertia, low_pass = effective_inertia(car, NOMINAL), low_pass_of(vehicle)
    return {
        "response_stroke": [coefficient(value, "response_stroke") for value in strokes],
        "response_rough": [
            coefficient(abs(ratio - 1.0) / (ratio + 1.0) * value, "response_rough")
            for value in strokes
        ],
        "response_knee": round(suspension.knee_speed * 2.0**fw.Q_RATE),
        "response_fast": [coefficient(falls * value, "response_fast") for value in strokes],
        "response_stretch": quantise(stretch, 30, 0, fw.ONE, name="response_stretch"),
        "response_lateral": coefficient(roll.roll_arm, "response_lateral"),
        "response_inertia": coefficient(inertia / low_pass, "response_inertia"),
        "response_pass": round(tick / low_pass * fw.ONE),
        "response_mean": round(tick / MEAN * fw.ONE),
    }


def _axles(
    task: Task, box: Uncertainty, residual: Residual, parts: Mapping[str, ResidualPart]
) -> Fields:
    """Return the fields of the axles monitor: moments of the rear as of the front axle's tyres."""
    stretch, damping = (
        parts[name].gains for name in ("suspensions and tyres apart", "dampers apart")
    )
    return {
        "axles_ticks": ticks_of(residual.time, task.tick),
        "axles_min": moment(residual.floor),
        "axles_rest": moment(AXLES_REST * car_of(task.vehicle).tyres[0]),
        "axles_limit": acceleration(residual.limit),
        "axles_stretch": [
            coefficient(task.tick * abs(gain), "axles_stretch") for gain in stretch.values()
        ],
        "axles_damping": [
            coefficient(damping[name] / gain / task.tick, "axles_damping")
            for name, gain in stretch.items()
        ],
        "axles_side": coefficient(parts[MAY_BE_WRONG].gains["lateral"], "axles_side"),
        "axles_rough": coefficient(box.bump / task.tick, "axles_rough"),
        "axles_rear": quantise(
            parts["rear moment"].gains["moment_rear"], 28, 0, 4 << 28, name="axles_rear"
        ),
        "axles_lateral": coefficient(
            parts["forces at the roll centres"].gains["lateral"], "axles_lateral"
        ),
        "axles_yaw": coefficient(parts["yaw at the roll centres"].gains["yaw_rate"], "axles_yaw"),
    }


def _heave(task: Task, box: Uncertainty, residual: Residual | None) -> Fields:
    """Return the fields of the heave monitor, of corner forces alone: a bar lifts nothing."""
    suspension = task.vehicle.suspension
    return {
        "heave_min": 0 if residual is None else moment(residual.floor),
        "heave_late": coefficient(late(box, task.tick, SLOW) / task.tick, "heave_late"),
        "heave_ticks": ticks_of(HEAVE_TIME, task.tick),
        "heave_stretch": [
            coefficient(task.tick * rate, "heave_stretch")
            for rate in (suspension.spring_rate_front, suspension.spring_rate_rear)
        ],
    }
