"""Axles of a vehicle by tables: what they say, what the vehicle file still says.

A vehicle file has tables in its sections ``[axles.front]`` and ``[axles.rear]``, or names CSV files
there; the numbers become part of the vehicle's document. Numbers of other sections that the tables
determine follow from these where the wheels stand at rest. In the plant a table whose number is
then changed, as in a population, is scaled to it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError
from canroll.vehicles import tyre_files
from canroll.vehicles.axles import Axle, axles, rebound_ratio
from canroll.vehicles.model import GRAVITY, RollModel, Vehicle
from canroll.vehicles.suspensions.tables import (
    AXLES,
    OF_FRONT,
    SECTION,
    VehicleTables,
    files_of,
    section,
)
from canroll.vehicles.suspensions.wheel import installed

OF_BARS = ("plant.roll_stiffness", "suspension.roll_stiffness_front_share")
BOTH: Mapping[str, tuple[str, ...]] = {
    "damper": (
        "plant.roll_damping",
        *("suspension.roll_damping_front_share", "suspension.rebound_bump_ratio"),
        *("suspension.knee_speed", "suspension.high_speed_ratio"),
    ),
    "stops": (
        *("suspension.bump_clearance", "suspension.rebound_clearance"),
        "suspension.bump_stop_rate",
    ),
    "bar": OF_BARS,
}
"""Tables that both axles have or none, with the keys of the vehicle that follow from them."""


def following(tables: VehicleTables) -> dict[str, str]:
    """Keys of the vehicle's file that follow from tables, with the table's key."""
    keys: dict[str, str] = {}
    for name, axle in zip(AXLES, tables.both, strict=True):
        if axle.spring is not None:
            keys[f"suspension.spring_rate_{name}"] = f"{SECTION}.{name}.spring"
        if axle.side is not None:
            keys[f"geometry.roll_centre_height_{name}"] = f"{SECTION}.{name}.kinematics"
        if axle.steering is not None:
            keys["steering.ratio"] = f"{SECTION}.{name}.steering"
    for kind, of in BOTH.items():
        if getattr(tables.front, kind) is not None:
            keys |= dict.fromkeys(of, f"{SECTION}.front.{kind}")
    return keys


def sources(tables: VehicleTables | None) -> dict[str, str]:
    """Sources of the numbers that follow from tables."""
    keys = {} if tables is None else following(tables)
    return {key: f"follows from {by}" for key, by in keys.items()}


def of_section(given: Any, where: str, folder: Path | None = None) -> VehicleTables:  # noqa: ANN401
    """Return the tables of a vehicle file's section ``axles``, of both axles together.

    Args:
        given: the section.
        where: begins every error message.
        folder: that its files' paths are relative to; None if it must not name any.

    Raises:
        CanrollError: see :func:`canroll.vehicles.suspensions.tables.section`, or an axle lacks a
            table that the other has.
    """
    tables = section(given, where, folder)
    for kind in BOTH:
        there = [getattr(axle, kind) is not None for axle in tables.both]
        if any(there) and not all(there):
            missing = AXLES[there.index(False)]
            raise CanrollError(
                f"{where}: {SECTION}.{missing}.{kind} is missing: both axles need one"
            )
    return tables


def embedded(table: Mapping[str, Any], folder: Path, where: str) -> dict[str, Any]:
    """Return a vehicle file's table with the numbers of its axles' files in it.

    Args:
        table: of the file, which may be short.
        folder: that the files' paths are relative to.
        where: begins every error message.

    Raises:
        CanrollError: a file that is no table of an axle.
    """
    given = table.get(SECTION)
    if not isinstance(given, Mapping) or not any(files_of(given)):
        return dict(table)
    sources = dict(table.get("sources", {}))
    for axle in AXLES:
        names = [name for of, name in files_of(given) if of == axle]
        if names and not any(key in sources for key in (SECTION, f"{SECTION}.{axle}")):
            sources[f"{SECTION}.{axle}"] = ", ".join(names)
    return {**table, SECTION: section(given, where, folder).document, "sources": sources}


def merged(base: Any, given: Any) -> Any:  # noqa: ANN401
    """Return the axles of a short file: its tables replace those of the base as a whole."""
    if not isinstance(base, Mapping) or not isinstance(given, Mapping):
        return given
    result = dict(base)
    for axle, tables in given.items():
        before = base.get(axle)
        both = isinstance(before, Mapping) and isinstance(tables, Mapping)
        kept = dict(before) if isinstance(before, Mapping) and both else {}
        if both and "spring" in tables:
            kept.pop("installed", None)
        result[axle] = {**kept, **tables} if both else tables
    return result


def with_steering(axles: Mapping[str, Any], of: Mapping[str, Any]) -> dict[str, Any]:
    """Return an ``axles`` section with what another one says of the steering, and that alone."""
    front = {key: value for key, value in axles.get("front", {}).items() if key not in OF_FRONT}
    front |= {key: value for key, value in of.get("front", {}).items() if key in OF_FRONT}
    return {name: table for name, table in {**axles, "front": front}.items() if table}


def without_following(
    table: Mapping[str, Any], own: Mapping[str, Any], where: str
) -> dict[str, Any]:
    """Return a short file's complete table without numbers of its base that follow from tables."""
    result = dict(table)
    if SECTION not in table:
        return result
    for key in following(of_section(table[SECTION], where)):
        part, name = key.split(".")
        for of in (part, "design") if part == "plant" else (part,):
            given, numbers = own.get(of), result.get(of)
            if isinstance(numbers, Mapping) and not (isinstance(given, Mapping) and name in given):
                result[of] = {key: value for key, value in numbers.items() if key != name}
    return result


def provisional(table: Mapping[str, Any], tables: VehicleTables, where: str) -> dict[str, Any]:
    """Return a complete table in which the numbers that follow from tables are still 1.

    A design without such a number has that of the plant.

    Raises:
        CanrollError: it has one of these.
    """
    result = dict(table)
    for key, by in following(tables).items():
        part, name = key.split(".")
        numbers = result.get(part)
        if isinstance(numbers, Mapping):
            if name in numbers:
                raise CanrollError(f"{where}: {key} follows from {by}: remove it")
            result[part] = {**numbers, name: 1.0}
        design = result.get("design")
        if part == "plant" and isinstance(design, Mapping) and name not in design:
            result["design"] = {**design, name: 1.0}
    return result


def standing(vehicle: Vehicle) -> Iterator[tuple[str, str]]:
    """Section and key of the numbers that follow from tables; of the design where it is equal."""
    if vehicle.axles is None:
        return
    for key in following(vehicle.axles):
        section_name, name = key.split(".")
        yield section_name, name
        if section_name == "plant" and getattr(vehicle.design, name) == getattr(
            vehicle.plant, name
        ):
            yield "design", name


def check_change(vehicle: Vehicle, key: str) -> None:
    """Check that a key of the vehicle's file does not follow from its tyre files or tables.

    Raises:
        CanrollError: it does.
    """
    tyre_files.check_change(vehicle, key)
    by = {} if vehicle.axles is None else following(vehicle.axles)
    if key in by:
        raise CanrollError(f"{key} follows from {by[key]}: change that")


def followed(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with the numbers that follow from its tyre files and tables at its loads.

    Raises:
        CanrollError: the tables hold no wheel of that load.
    """
    # the tyres' radius is part of the roll stiffness
    vehicle = tyre_files.followed(vehicle)
    if vehicle.axles is None:
        return vehicle
    loads = [
        load - 0.5 * unsprung * GRAVITY
        for load, unsprung in zip(
            vehicle.wheel_loads,
            (vehicle.mass.unsprung_front, vehicle.mass.unsprung_rear),
            strict=True,
        )
    ]
    tables = VehicleTables(
        *(
            installed(axle, load, f"{vehicle.name}: {SECTION}.{name}")
            for name, axle, load in zip(AXLES, vehicle.axles.both, loads, strict=True)
        )
    )
    keys = following(tables)
    vehicle = replace(vehicle, axles=tables)
    both = axles(vehicle)
    numbers: dict[str, float] = {}
    for axle in both:
        curves = axle.curves
        numbers[f"suspension.spring_rate_{axle.name}"] = curves.rate
        height = axle.half_track * curves.change("side")
        numbers[f"geometry.roll_centre_height_{axle.name}"] = height
        if axle.tables.steering is not None:
            numbers["steering.ratio"] = 1.0 / axle.tables.steering.slope(0.0)
    numbers |= _of_dampers(both) | _of_stops(both)
    changed = _with(vehicle, {key: value for key, value in numbers.items() if key in keys})
    if OF_BARS[0] not in keys:
        return changed
    return _with(changed, _of_bars(changed))


def _of_dampers(both: Sequence[Axle]) -> dict[str, float]:
    slopes = [axle.curves.damping for axle in both]
    parts = [
        axle.half_track**2 * (compression + rebound)
        for axle, (compression, rebound) in zip(both, slopes, strict=True)
    ]
    if not all(parts):
        return {}
    dampers = [axle.tables.damper for axle in both]
    return {
        "plant.roll_damping": sum(parts),
        "suspension.roll_damping_front_share": parts[0] / sum(parts),
        "suspension.rebound_bump_ratio": rebound_ratio(both),
        # the tables have their own
        "suspension.knee_speed": max(damper.x[-1] for damper in dampers if damper is not None),
        "suspension.high_speed_ratio": 1.0,
    }


def _of_stops(both: Sequence[Axle]) -> dict[str, float]:
    curves = [axle.curves for axle in both]
    return {
        "suspension.bump_clearance": min(each.clearances[0] for each in curves),
        "suspension.rebound_clearance": min(each.clearances[1] for each in curves),
        "suspension.bump_stop_rate": max(each.stop_rate for each in curves),
    }


def _of_bars(vehicle: Vehicle) -> dict[str, float]:
    """Roll stiffness of the car on its springs, bars and tyres, and the front axle's share."""
    from canroll.vehicles.roll_stiffness import steady_roll  # noqa: PLC0415 - scipy, which only bars need

    assert vehicle.axles is not None
    parts = [
        2.0 * axle.half_track**2 * (axle.spring + 2.0 * tables.bar.stiffness)
        for axle, tables in zip(axles(vehicle), vehicle.axles.both, strict=True)
        if tables.bar is not None
    ]
    share = {OF_BARS[1]: parts[0] / sum(parts)}
    gradient = steady_roll(_with(vehicle, share), sum(parts))[0]
    arm = vehicle.plant.roll_arm
    if not gradient > 0.0:
        raise CanrollError(
            f"{vehicle.name}: {SECTION}: springs, bars and tyres do not hold the body up"
        )
    return share | {OF_BARS[0]: arm / gradient + arm * GRAVITY}


def _with(vehicle: Vehicle, numbers: Mapping[str, float]) -> Vehicle:
    """Return the vehicle with other numbers; a design equal to the plant stays so."""
    parts: dict[str, Any] = {}
    for key, value in numbers.items():
        part, name = key.split(".")
        parts.setdefault(part, {})[name] = value
    changed = {part: replace(getattr(vehicle, part), **new) for part, new in parts.items()}
    if "plant" in parts:
        design: RollModel = vehicle.design
        equal = {
            name: value
            for name, value in parts["plant"].items()
            if getattr(design, name) == getattr(vehicle.plant, name)
        }
        changed["design"] = replace(design, **equal)
    return replace(vehicle, **changed)
