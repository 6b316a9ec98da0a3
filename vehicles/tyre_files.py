"""Tyres of a vehicle by their .tir files: what the files say, what the vehicle file still says.

A vehicle file names them in its ``[tyre]`` section; their coefficients become the section
``magic_formula``, so that a vehicle's document stands alone. Numbers of the ``[tyre]`` section that
depend on the load follow from the coefficients at the wheels' loads at rest.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError, UnknownNameError
from canroll.vehicles.model import Tyre, TyreFiles, Vehicle
from canroll.vehicles.tyres import tir
from canroll.vehicles.tyres.magic_formula import (
    KEYS,
    NEEDED,
    NEW,
    OLD,
    POSITIVE,
    SCALES,
    Coefficients,
)

SECTION = "magic_formula"
AXLES = ("front", "rear")
FILES = ("file", "file_front", "file_rear")
"""Keys of ``[tyre]`` that name files."""
FOLLOWING = (
    *("cornering_stiffness_front", "cornering_stiffness_rear", "longitudinal_stiffness"),
    *("friction", "friction_load_slope", "cornering_load_slope", "shape", "curvature", "radius"),
)
"""Keys of ``[tyre]`` that always follow from the files."""
WHEEL = {"vertical_stiffness": "VERTICAL_STIFFNESS", "vertical_damping": "VERTICAL_DAMPING"}
"""Keys of ``[tyre]`` that are taken from the files where these have them."""
SLOPE_STEP = 1e-3
"""Share of the load by which slopes over it are differenced."""


def embedded(table: Mapping[str, Any], folder: Path, where: str) -> dict[str, Any]:
    """Return a vehicle file's table with the coefficients of its tyre files in it.

    Args:
        table: of the file, which may be short.
        folder: that the files' paths are relative to.
        where: begins every error message.

    Raises:
        CanrollError: a tyre file that is none, or a key of ``[tyre]`` that contradicts it.
    """
    tyre = table.get("tyre")
    if not isinstance(tyre, Mapping) or not any(key in tyre for key in FILES):
        return dict(table)
    names = _names(tyre, where)
    if SECTION in table:
        raise CanrollError(f"{where}: [{SECTION}] and tyre.{FILES[0]}: give one of them")
    files = tuple(tir.read(folder / name) for name in names)
    standing = {key: value for key, value in tyre.items() if key not in FILES}
    for key in following(*files):
        if key in standing:
            raise CanrollError(f"{where}: tyre.{key} follows from {names[0]}: remove it")
    sources = dict(table.get("sources", {}))
    for key, name in WHEEL.items():
        values = {file[name] for file in files if name in file.values}
        if len(values) > 1:
            if key not in standing:
                raise CanrollError(
                    f"{where}: {names[0]} and {names[1]} differ in {name}, but both axles have "
                    f"one tyre.{key}: give it"
                )
        elif values:
            if key in standing:
                raise CanrollError(
                    f"{where}: tyre.{key} and {name} of {names[0]}: remove one of them"
                )
            standing[key] = values.pop()
            sources[f"tyre.{key}"] = f"{names[0]}, {name}"
    section = {}
    for axle, name, file in zip(AXLES, names, files, strict=True):
        section[axle] = {**dict.fromkeys(SCALES, 1.0), **file.values}
        sources[f"{SECTION}.{axle}"] = name
    return {**table, "tyre": standing, SECTION: section, "sources": sources}


def _names(tyre: Mapping[str, Any], where: str) -> tuple[str, str]:
    both, *each = (tyre.get(key) for key in FILES)
    names = (both, both) if both is not None else tuple(each)
    if both is not None and any(name is not None for name in each):
        raise CanrollError(f"{where}: tyre.file is for both axles: remove it or the others")
    for key, name in zip(FILES[1:], names, strict=True):
        if name is None:
            raise CanrollError(f"{where}: tyre.{key} is missing: both axles need a tyre file")
        if not isinstance(name, str):
            raise CanrollError(f"{where}: tyre.{key} must be the path of a .tir file")
    return str(names[0]), str(names[1])


def following(*files: Coefficients) -> tuple[str, ...]:
    """Keys of ``[tyre]`` that follow from the files at the vehicle's loads."""
    relaxing = all(file.relaxation(file["FNOMIN"]) is not None for file in files)
    return (*FOLLOWING, "relaxation_length") if relaxing else FOLLOWING


def merged(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return a base's table without what the tyre files of a short file replace.

    Coefficients of a complete set are not mixed with those of another tyre.
    """
    tyres = own.get(SECTION)
    if tyres is None or not is_complete(tyres):
        return dict(base)
    gone = following(*(Coefficients(tyres[axle]) for axle in AXLES))
    kept = {key: value for key, value in base.get("tyre", {}).items() if key not in gone}
    rest = {key: value for key, value in base.items() if key != SECTION}
    return {**rest, "tyre": kept} if "tyre" in base else rest


def is_complete(section: Any) -> bool:  # noqa: ANN401
    """Whether it has the coefficients of tyres, not only changes of them."""
    return isinstance(section, Mapping) and all(
        isinstance(part := section.get(axle), Mapping) and "FITTYP" in part for axle in AXLES
    )


def section(table: Any, where: str) -> TyreFiles:  # noqa: ANN401
    """Return the tyres of a complete table's ``magic_formula`` section.

    Raises:
        CanrollError: it is none.
    """
    for axle in AXLES:
        part = table.get(axle) if isinstance(table, Mapping) else None
        at = f"{where}: [{SECTION}.{axle}]"
        if not isinstance(part, Mapping):
            raise CanrollError(f"{at} is missing")
        for key, value in part.items():
            if key not in KEYS:
                raise CanrollError(f"{at} {UnknownNameError('coefficient', key, KEYS)}")
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise CanrollError(f"{at} {key} must be a number, not {value!r}")
        for key in NEEDED:
            if key not in part:
                raise CanrollError(f"{at} {key} is missing")
        if part["FITTYP"] not in (*OLD, *NEW):
            raise CanrollError(f"{at} FITTYP = {part['FITTYP']:g}: no version that is read")
        for key in POSITIVE:
            if not part.get(key, 1.0) > 0.0:
                raise CanrollError(f"{at} {key} = {part[key]:g}: must be positive")
    return TyreFiles(*({k: float(v) for k, v in table[axle].items()} for axle in AXLES))


def provisional(standing: Mapping[str, Any], files: TyreFiles, where: str) -> dict[str, Any]:
    """Return the table of a tyre section whose following numbers are still 1.

    Raises:
        CanrollError: it has one of these.
    """
    keys = following(Coefficients(files.front), Coefficients(files.rear))
    for key in keys:
        if key in standing:
            raise CanrollError(f"{where}: tyre.{key} follows from the tyre's file: remove it")
    return {**dict.fromkeys(keys, 1.0), **standing}


def standing(vehicle: Vehicle) -> set[str]:
    """Keys of the tyre section that do not follow from the vehicle's tyre files."""
    keys = set(Tyre.__dataclass_fields__)
    return keys - set(following(*coefficients(vehicle))) if vehicle.magic_formula else keys


def check_change(vehicle: Vehicle, key: str) -> None:
    """Check that a key of the vehicle's file does not follow from its tyre files.

    Raises:
        CanrollError: it does.
    """
    section, _, name = key.partition(".")
    if section == "tyre" and name in set(Tyre.__dataclass_fields__) - standing(vehicle):
        raise CanrollError(
            f"{key} follows from the tyre's file: change its scaling factors, as "
            f"{SECTION}.front.LMUY or LKY"
        )


def followed(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with those numbers of its tyres that follow from files at its loads."""
    if vehicle.magic_formula is None:
        return vehicle
    files, loads = coefficients(vehicle), vehicle.wheel_loads
    pairs = tuple(zip(files, loads, strict=True))

    def mean(values: list[float]) -> float:
        return sum(values) / len(values)

    def slope(of: str) -> float:
        """Relative fall of a quantity per load, over the load's own rise."""
        falls = []
        for file, load in pairs:
            quantity = getattr(file, of)
            more, less = ((1.0 + step) * load for step in (SLOPE_STEP, -SLOPE_STEP))
            change = quantity(more) / more - quantity(less) / less
            falls.append(-change / (2.0 * SLOPE_STEP) / (quantity(load) / load))
        return mean(falls)

    grips = [abs(file.friction(load)) for file, load in pairs]
    relaxations = [file.relaxation(load) for file, load in pairs]
    stiffness = vehicle.tyre.vertical_stiffness
    tyre = replace(
        vehicle.tyre,
        cornering_stiffness_front=-2.0 * files[0].cornering(loads[0]),
        cornering_stiffness_rear=-2.0 * files[1].cornering(loads[1]),
        longitudinal_stiffness=mean([file.longitudinal(load) for file, load in pairs]),
        friction=mean(grips),
        friction_load_slope=slope("grip"),
        cornering_load_slope=slope("cornering"),
        shape=mean([file["PCY1"] * file["LCY"] for file in files]),
        curvature=mean([file.curvature(load) for file, load in pairs]),
        radius=mean([file["UNLOADED_RADIUS"] - load / stiffness for file, load in pairs]),
    )
    lengths = [length for length in relaxations if length is not None]
    if len(lengths) == len(files):
        tyre = replace(tyre, relaxation_length=mean(lengths))
    return replace(vehicle, tyre=tyre)


def scaled(vehicle: Vehicle, cornering: float, friction: float) -> Vehicle:
    """Return the vehicle with stiffer tyres of more grip, by factors."""
    if vehicle.magic_formula is None:
        tyre = vehicle.tyre
        return replace(
            vehicle,
            tyre=replace(
                tyre,
                cornering_stiffness_front=tyre.cornering_stiffness_front * cornering,
                cornering_stiffness_rear=tyre.cornering_stiffness_rear * cornering,
                friction=tyre.friction * friction,
            ),
        )
    factors = {"LKY": cornering, "LMUX": friction, "LMUY": friction}
    files = TyreFiles(
        *(
            {**file.values, **{key: file[key] * factor for key, factor in factors.items()}}
            for file in coefficients(vehicle)
        )
    )
    return followed(replace(vehicle, magic_formula=files))


def outside(vehicle: Vehicle) -> list[str]:
    """Limits of the tyre files that the vehicle at rest does not keep, one line each."""
    lines = []
    for axle, file, load in zip(AXLES, coefficients(vehicle), vehicle.wheel_loads, strict=False):
        quantities = {"FZ": ("wheel load at rest", load, "N")}
        if "INFLPRES" in file.values:
            quantities["PRES"] = ("inflation pressure", file["INFLPRES"], "Pa")
        for name, (words, value, unit) in quantities.items():
            low, high = f"{name}MIN", f"{name}MAX"
            if low in file.values and value < file[low]:
                lines.append(f"tyre file, {axle}: {words} {value:.0f} {unit} < {low} {file[low]:g}")
            if high in file.values and value > file[high]:
                lines.append(
                    f"tyre file, {axle}: {words} {value:.0f} {unit} > {high} {file[high]:g}"
                )
    return lines


def coefficients(vehicle: Vehicle) -> tuple[Coefficients, ...]:
    """Coefficients of the front and the rear tyre; empty where the vehicle has no tyre files."""
    files = vehicle.magic_formula
    return () if files is None else (Coefficients(files.front), Coefficients(files.rear))
