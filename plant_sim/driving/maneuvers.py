"""The manoeuvres by name: inputs, speeds and durations."""

from dataclasses import dataclass, replace
from inspect import Parameter, signature
from typing import Any

import numpy as np

from canroll.errors import CanrollError, UnknownNameError
from canroll.typing import Vector
from plant_sim.driving import MANEUVERS
from plant_sim.driving.drive import STEP_NS, make_drive, understeer
from plant_sim.driving.driver import (
    D_CHASSIS_CONTROL,
    D_STEER_RATE,
    D_TABLE_STEP,
    N_MEMORY,
    STEER_TABLE,
    Drive,
)
from vehicles import Vehicle

__all__ = [
    "STEP_NS",
    "Maneuver",
    "build",
    "default_speed",
    "names",
    "options",
    "replay",
    "speed_range",
    "title",
    "understeer",
]

SLOWEST_KMH = 5.0
"""Slowest speed that the tyre and bicycle models make sense at (km/h)."""


@dataclass(frozen=True, slots=True)
class Maneuver:
    """One manoeuvre, ready to run once: ``drive`` holds the driver's memory.

    ``speed`` (m/s) at entry; ``standard`` is the standard it follows, with deviations.
    """

    name: str
    title: str
    standard: str
    speed: float
    duration_ns: int
    drive: Drive


def names() -> list[str]:
    """The names accepted by :func:`build`, sorted."""
    return sorted(MANEUVERS)


def title(name: str) -> str:
    """Title of the manoeuvre in a report."""
    return MANEUVERS[name].title


def options(name: str) -> dict[str, Any]:
    """The options of that manoeuvre with their defaults; a preview of 0 means the vehicle's."""
    kind = MANEUVERS[name]
    parameters = signature(kind.plan).parameters.values()
    own = {item.name: item.default for item in parameters if item.kind is Parameter.KEYWORD_ONLY}
    common = {"friction": kind.friction, "chassis_control": kind.chassis_control}
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


def _checked(name: str, given: dict[str, Any]) -> dict[str, Any]:
    known = options(name)
    checked = {}
    for key, value in given.items():
        if value is None:
            continue
        if key not in known:
            raise UnknownNameError(f"option of {name}", key, known)
        checked[key] = _converted(value, known[key], f"option {key} of {name}")
    friction = checked.get("friction", 1.0)
    if not 0.05 <= friction <= 1.5:
        raise CanrollError(f"the friction must be 0.05 to 1.5, got {friction:g}")
    preview = checked.get("preview_time", 0.0)
    if preview != 0.0 and not 0.3 <= preview <= 3.0:
        raise CanrollError(f"the preview time must be 0.3 to 3 s, got {preview:g}")
    for key in ("radius", "length", "spacing", "duration", "scale"):
        if key in checked and checked[key] <= 0:
            raise CanrollError(f"option {key} of {name}: {checked[key]:g} must be positive")
    if abs(checked.get("bank_deg", 0.0)) > 30:
        raise CanrollError(f"the bank must be at most 30 degrees, got {checked['bank_deg']:g}")
    return checked


def build(
    name: str,
    vehicle: Vehicle,
    speed: float | None = None,
    seed: int = 0,
    **given: Any,  # noqa: ANN401
) -> Maneuver:
    """Prepare one manoeuvre for one run.

    Args:
        name: one of :func:`names`.
        vehicle: vehicle to drive; some manoeuvres are scaled to it.
        speed: entry speed in m/s; by default that of the vehicle or the manoeuvre.
        seed: seed of the random part of the manoeuvre, the road.
        given: options of :func:`options`; None for the default. Among them ``preview_time`` (s),
        the
            driver's preview instead of the vehicle's: 0.5 experienced, 0.75, 1.0 novice;
            ``friction`` of the road; ``chassis_control``, the vehicle's yaw control.

    Raises:
        UnknownNameError: there is no manoeuvre or option of that name.
        CanrollError: a speed or an option is outside the manoeuvre's range.
    """
    kind = MANEUVERS[name]
    speed = default_speed(name, vehicle) if speed is None else speed
    if not SLOWEST_KMH <= speed * 3.6 <= kind.fastest_kmh + 1e-6:
        raise CanrollError(
            f"speed {speed * 3.6:g} km/h: the speed of the {kind.title} must be "
            f"{SLOWEST_KMH:g} to {kind.fastest_kmh:g} km/h"
        )
    chosen = {**options(name), **_checked(name, given)}
    common = {key: chosen.pop(key) for key in ("friction", "chassis_control", "preview_time")}
    plan = kind.plan(vehicle, speed, seed, **chosen)
    standard = kind.standard
    if name == "double_lane_change":
        if speed * 3.6 > 80.5:
            standard += ", non-standard: driven faster than 80 km/h"
        if vehicle.lane_offset != 3.5:
            standard += f", non-standard: lane offset {vehicle.lane_offset:g} m"
    return Maneuver(
        name=name,
        title=kind.title,
        standard=standard,
        speed=speed,
        duration_ns=round(plan.duration * 1e9 / STEP_NS) * STEP_NS,
        drive=make_drive(vehicle, speed, plan, **common),
    )


def replay(maneuver: Maneuver, steer: Vector) -> Maneuver:
    """Return the same manoeuvre with the steering of an earlier run replayed, without a driver.

    ``steer``: road-wheel angle (rad), one value per step, as recorded. A law then changes only the
    motion of the car, without driver feedback. The recorded angle includes the chassis control's
    part, so chassis control is off.
    """
    parameters = maneuver.drive.parameters.copy()
    parameters[D_CHASSIS_CONTROL] = 0.0
    parameters[D_TABLE_STEP] = STEP_NS * 1e-9
    parameters[D_STEER_RATE] = np.inf
    drive = maneuver.drive._replace(
        kind=STEER_TABLE,
        parameters=parameters,
        table=np.ascontiguousarray(steer),
        memory=np.zeros(N_MEMORY),
    )
    return replace(maneuver, title=f"{maneuver.title}, steering replayed", drive=drive)
