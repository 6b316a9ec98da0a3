"""The manoeuvres by name: inputs, speeds and durations."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from inspect import Parameter, signature
from math import isclose
from typing import Any

import numpy as np

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.driving import MANEUVERS, road
from canroll.plant_sim.driving.drive import ManeuverKind, ManeuverPlan, make_drive
from canroll.plant_sim.driving.driver import (
    ACCELERATION_TABLE,
    FOLLOW_PATH,
    MEMORY,
    OVER_DISTANCE,
    SPEED_LAG,
    STEER_TABLE,
    DriveInputs,
)
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.typing import Vector
from canroll.vehicles import Vehicle
from canroll.vehicles.equipment import GUESSED_AIR

__all__ = [
    "STEP_NS",
    "Maneuver",
    "build",
    "default_speed",
    "names",
    "options",
    "replay",
    "speed_range",
    "straightened",
    "title",
    "written",
]

SLOWEST_KMH = 5.0
"""Slowest speed that the tyre and bicycle models make sense at (km/h)."""


@dataclass(frozen=True, slots=True)
class Maneuver:
    """One manoeuvre, ready to run once: ``drive`` holds the driver's memory.

    ``speed`` (m/s) at entry; ``standard`` is the standard it follows, with deviations;
    ``options`` are all that are in effect, defaults too; ``remarks`` what was left out of a file.
    """

    name: str
    title: str
    standard: str
    speed: float
    duration_ns: int
    drive: DriveInputs
    options: Mapping[str, Any] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def names() -> list[str]:
    """The names accepted by :func:`build`, sorted."""
    return sorted(MANEUVERS)


def title(name: str) -> str:
    """Title of the manoeuvre in a report."""
    return MANEUVERS[name].title


def options(name: str) -> dict[str, Any]:
    """The options of that manoeuvre with their defaults; a preview of 0 is by rule."""
    kind = MANEUVERS[name]
    parameters = signature(kind.plan).parameters.values()
    own = {item.name: item.default for item in parameters if item.kind is Parameter.KEYWORD_ONLY}
    common = {"friction": kind.friction, "chassis_control": kind.chassis_control, "road": ""}
    return {**own, **common, "preview_time": 0.0}


def default_speed(name: str, vehicle: Vehicle) -> float:
    """Entry speed (m/s) of that manoeuvre: the vehicle's if its file states one."""
    return vehicle.speeds.get(name, MANEUVERS[name].speed_kmh / 3.6)


def speed_range(name: str) -> tuple[float, float]:
    """Slowest and fastest entry speed (m/s) of that manoeuvre."""
    return SLOWEST_KMH / 3.6, MANEUVERS[name].fastest_kmh / 3.6


def _converted(value: Any, default: Any, what: str) -> Any:  # noqa: ANN401
    """``value`` as the type of ``default``; values of a command line come as text."""
    if isinstance(default, bool):
        known = {"on": True, "true": True, "1": True, "off": False, "false": False, "0": False}
        text = str(value).lower()
        if text not in known:
            raise CanrollError(f"{what} must be on or off, got {value!r}")
        return known[text]
    if isinstance(default, str):
        return str(value)
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise CanrollError(f"{what}: {value!r} is not a number") from error
    if not np.isfinite(number):
        raise CanrollError(f"{what}: {value!r} is not finite")
    return number


@dataclass(frozen=True, slots=True)
class Limits:
    """Unit and range of an option."""

    unit: str
    low: float
    high: float


OPTIONS: Mapping[str, Limits] = {
    **dict.fromkeys(
        ("friction", "friction_left", "friction_right", "friction_after"), Limits("", 0.05, 1.5)
    ),
    "crosswind": Limits("m/s", *road.COLUMNS["crosswind"]),
    "acceleration": Limits("m/s²", -10.0, 5.0),
    "preview_time": Limits("s", 0.3, 3.0),
    "radius": Limits("m", 5.0, 10_000.0),
    "bank_deg": Limits("°", -30.0, 30.0),
    "height": Limits("m", -0.5, 0.5),
    "length": Limits("m", 0.05, 1000.0),
    "spacing": Limits("m", 1.0, 10_000.0),
    "count": Limits("", 1, 1000),
    "duration": Limits("s", 0.1, 100_000.0),
    "scale": Limits("", 0.01, 100.0),
    "lateral_acceleration": Limits("m/s²", 0.1, 15.0),
    "steer_rate": Limits("°/s", 10.0, 2000.0),
    "lowest": Limits("Hz", 0.05, 10.0),
    "highest": Limits("Hz", 0.05, 10.0),
    "deceleration": Limits("m/s²", 0.5, 10.0),
}
"""Limits of the numbers among the options of the built-in manoeuvres, by name."""

TEXTS: Mapping[str, str] = {
    "file": "CSV, MF4, or bus log with dbc",
    "dbc": "network description of a bus log",
    "column": "signal of the file that is the steering or lateral acceleration",
    "unit": "deg, rad, m/s2 or g; default that of the file",
    "speed_column": "signal of the file that is the speed; default speed_kmh of a CSV; none",
    "speed_unit": "km/h, m/s or mph; default that of the file",
    "road": "CSV of what the car meets over distance: friction, bank, heights, wind, speed",
    "road_class": "A to E of ISO 8608",
    "side": "left, right or both",
    "shape": "cosine or half_sine",
}
"""What the texts among them are."""


def describe(key: str, default: Any) -> str:  # noqa: ANN401
    """Return default, unit and range of an option in words, or what it is."""
    limits = OPTIONS.get(key)
    if limits is None:
        shown = ("off", "on")[default] if isinstance(default, bool) else default
        what = [f"default {shown}"] if shown else []
        return ", ".join([*what, *([TEXTS[key]] if key in TEXTS else [])]) or "no default"
    unit = f" {limits.unit}" if limits.unit else ""
    start = (
        "default by vehicle and speed" if key == "preview_time" else f"default {default:g}{unit}"
    )
    return f"{start}, {limits.low:g} to {limits.high:g}{unit}"


def written(options: Mapping[str, Any]) -> dict[str, str]:
    """Return each option's name and value with its unit, as people read them."""
    texts = {}
    for key, value in options.items():
        limits = OPTIONS.get(key)
        unit = f" {limits.unit}" if limits is not None and limits.unit else ""
        text = ("off", "on")[value] if isinstance(value, bool) else str(value)
        number = isinstance(value, float | int) and not isinstance(value, bool)
        name = key.removesuffix("_deg").replace("_", " ")
        texts[name] = f"{value:g}{unit}" if number else text
    return texts


def _checked(name: str, given: dict[str, Any]) -> dict[str, Any]:
    known = options(name)
    checked = {}
    for key, value in given.items():
        if value is None:
            continue
        if key not in known:
            raise UnknownNameError(f"option of {name}", key, known)
        checked[key] = _converted(value, known[key], f"option {key} of {name}")
    for key, value in checked.items():
        limits = OPTIONS.get(key)
        if limits is None or (key == "preview_time" and value == 0.0):
            continue
        if not limits.low <= value <= limits.high:
            unit = f" {limits.unit}" if limits.unit else ""
            raise CanrollError(
                f"option {key} of {name}: {value:g}{unit} must be {limits.low:g} to "
                f"{limits.high:g}{unit}"
            )
    return checked


def build(
    name: str,
    vehicle: Vehicle,
    speed: float | None = None,
    seed: int = 0,
    /,
    **given: Any,  # noqa: ANN401
) -> Maneuver:
    """Prepare one manoeuvre for one run.

    Args:
        name: one of :func:`names`.
        vehicle: vehicle to drive; some manoeuvres are scaled to it.
        speed: entry speed in m/s; by default that of the vehicle or the manoeuvre, or the first of
            a manoeuvre with a speed over time.
        seed: seed of the random part of the manoeuvre, the road.
        given: options of :func:`options`; None for the default. Among them are
            ``preview_time`` (s) of the driver, ``friction`` of the road, ``road``, a file of
            :func:`canroll.plant_sim.driving.road.on_road`, and ``chassis_control``, the vehicle's
            yaw control.

    Raises:
        UnknownNameError: there is no manoeuvre or option of that name.
        CanrollError: a speed or an option is outside the manoeuvre's range, or the speed is
            another than the first of a speed over time.
    """
    kind = MANEUVERS[name]
    entry = default_speed(name, vehicle) if speed is None else speed
    _check_speeds(kind, np.array([entry]))
    chosen = {**options(name), **_checked(name, given)}
    effective = {key: value for key, value in chosen.items() if value != ""}
    common = {key: chosen.pop(key) for key in ("friction", "chassis_control", "preview_time")}
    file = chosen.pop("road")
    plan = kind.plan(vehicle, entry, seed, **chosen)
    standard = kind.standard
    if file:
        plan = road.on_road(plan, file)
        standard += "" if standard == "none" else ", non-standard: on the road of a file"
    if plan.speed is not None:
        _check_speeds(kind, plan.speed)
        entry = float(plan.speed[0])
        if speed is not None and not isclose(speed, entry, rel_tol=1e-6):
            raise CanrollError(
                f"speed {speed * 3.6:g} km/h: this {kind.title} has a speed over time, "
                f"{entry * 3.6:g} km/h at its start: omit --speed"
            )
    if name == "double_lane_change":
        if entry * 3.6 > 80.5:
            standard += ", non-standard: driven faster than 80 km/h"
        if vehicle.lane_offset != 3.5:
            standard += f", non-standard: lane offset {vehicle.lane_offset:g} m"
    drive = make_drive(vehicle, entry, plan, **common)
    if plan.kind == FOLLOW_PATH:
        effective["preview_time"] = float(drive.parameters["preview_time"][0])
    else:
        del effective["preview_time"]
    return Maneuver(
        name=name,
        title=kind.title,
        standard=standard,
        speed=entry,
        duration_ns=round(plan.duration * 1e9 / STEP_NS) * STEP_NS,
        drive=drive,
        options=effective,
        remarks=(*plan.remarks, *_guesses(vehicle, plan)),
    )


def _guesses(vehicle: Vehicle, plan: ManeuverPlan) -> Iterator[str]:
    """Yield what a manoeuvre needs that the vehicle's file does not have."""
    if plan.wind is not None and vehicle.aerodynamics is None:
        yield f"{vehicle.name} has no [aerodynamics] for the wind, {GUESSED_AIR}"


def check_inputs(name: str, speed: float | None, given: dict[str, Any]) -> None:
    """Refuse a speed (m/s) and options that a manoeuvre takes of no vehicle, as :func:`build`."""
    if speed is not None:
        _check_speeds(MANEUVERS[name], np.array([speed]))
    _checked(name, given)


def _check_speeds(kind: ManeuverKind, speeds: Vector) -> None:
    """Refuse speeds (m/s) outside the manoeuvre's range, several with their place in time."""
    kmh = 3.6 * speeds
    outside = ~((kmh >= SLOWEST_KMH - 1e-6) & (kmh <= kind.fastest_kmh + 1e-6))
    if outside.any():
        first = int(np.argmax(outside))
        when = f" at {first * STEP_NS * 1e-9:.3f} s" if len(speeds) > 1 else ""
        raise CanrollError(
            f"speed {kmh[first]:g} km/h{when}: the speed of the {kind.title} must be "
            f"{SLOWEST_KMH:g} to {kind.fastest_kmh:g} km/h"
        )


def replay(maneuver: Maneuver, steer: Vector) -> Maneuver:
    """Return the same manoeuvre with the steering of an earlier run replayed, without a driver.

    ``steer``: road-wheel angle (rad), one value per step, as recorded. A law then changes only the
    motion of the car, without driver feedback. The recorded angle includes the chassis control's
    part, so chassis control is off.
    """
    parameters = maneuver.drive.parameters.copy()
    parameters["chassis_control"] = 0.0
    parameters["table_step"] = STEP_NS * 1e-9
    parameters["steer_rate"] = np.inf
    drive = maneuver.drive._replace(
        kind=STEER_TABLE,
        parameters=parameters,
        table=np.ascontiguousarray(steer),
        memory=np.zeros(1, MEMORY),
    )
    return replace(maneuver, title=f"{maneuver.title}, steering replayed", drive=drive)


def straightened(maneuver: Maneuver, steer: Vector, speed: Vector, duration: float) -> Maneuver:
    """Return the manoeuvre that follows an earlier run and then goes straight on.

    At the end of the earlier run the steering returns to 0 as fast as the driver or robot can; the
    height and bank of the road stay as they are there, and so does the speed that is driven.

    Args:
        maneuver: the manoeuvre that was driven.
        steer: road-wheel angle of the earlier run, rad, one value per step.
        speed: longitudinal speed of the earlier run, m/s, one value per step.
        duration: duration of the new run, s.
    """
    drive, dt = maneuver.drive, STEP_NS * 1e-9
    if drive.kind == ACCELERATION_TABLE:
        first = int(len(steer) * dt / drive.parameters["table_step"][0])
        table = np.append(drive.table[: first + 1], 0.0)
    else:
        steps = 1 + int(abs(steer[-1]) / (drive.parameters["steer_rate"][0] * dt))
        maneuver = replay(maneuver, np.append(steer, np.linspace(steer[-1], 0.0, steps + 1)[1:]))
        drive = maneuver.drive
        table = drive.table
    travelled = float(np.sum(np.maximum(speed, 0.0))) * dt
    passed = 1 + int(travelled / drive.parameters["road_step"][0])
    seen = 1 + len(steer) + round(0.5 * SPEED_LAG / dt)
    return replace(
        maneuver,
        duration_ns=round(duration * 1e9 / STEP_NS) * STEP_NS,
        drive=drive._replace(
            parameters=drive.parameters.copy(),
            table=table,
            speed=drive.speed[:seen],
            memory=np.zeros(1, MEMORY),
            **{name: getattr(drive, name)[:passed] for name in OVER_DISTANCE},
        ),
    )
