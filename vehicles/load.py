"""Reader of vehicles from TOML: presets by name, users' files by path."""

from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_origin, get_type_hints

from canroll.documents import parse_toml
from canroll.documents import text as read_text
from canroll.errors import CanrollError, UnknownNameError, reason
from vehicles.check import problems
from vehicles.model import Empty, Vehicle

SCHEMA = 1
"""Version of the file format that this loader reads."""

_FOLDER = Path(__file__).parent
_SECTIONS = (
    "design",
    "plant",
    "geometry",
    "mass",
    "suspension",
    "tyre",
    "steering",
    "driver",
    "actuators",
    "sensors",
)
_OPTIONAL = {"empty": Empty}


def names() -> list[str]:
    """The names of the presets, sorted."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def load(name_or_path: str | Path) -> Vehicle:
    """Read the preset of that name, or the vehicle file at that path.

    Args:
        name_or_path: a name of :func:`names`, or a path (anything that ends in ``.toml`` or
        contains a
            separator).

    Raises:
        UnknownNameError: there is no preset of that name; the message suggests the nearest.
        CanrollError: the file cannot be read, is not a vehicle, or describes an impossible one.
    """
    text = str(name_or_path)
    file = ""
    if isinstance(name_or_path, Path) or text.endswith(".toml") or "/" in text or "\\" in text:
        path, file = Path(name_or_path), text
    else:
        path = _FOLDER / f"{text}.toml"
        if text not in names():
            raise UnknownNameError("vehicle", text, names())
    try:
        content = read_text(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"cannot read vehicle file {path}: {reason(error)}") from error
    if not content.strip():
        raise CanrollError(f"{path}: empty file")
    try:
        table = parse_toml(content)
    except ValueError as error:
        raise CanrollError(f"{path}: not a TOML file: {error}") from error
    return replace(from_table(table, name=path.stem, where=str(path)), file=file)


def from_table(table: Mapping[str, Any], *, name: str, where: str = "vehicle") -> Vehicle:
    """Build a vehicle from a parsed file; ``where`` begins every error message."""
    _keys(
        table,
        required={"schema", "title", "basis", "maneuvers", "sources", *_SECTIONS},
        optional=set(_OPTIONAL),
        where=where,
        section="",
    )
    if table["schema"] != SCHEMA:
        raise CanrollError(f"{where}: schema {table['schema']!r}, but this version reads {SCHEMA}")
    hints = get_type_hints(Vehicle)
    parts = {key: _record(hints[key], table[key], where, key) for key in _SECTIONS}
    for key, kind in _OPTIONAL.items():
        if key in table:
            parts[key] = _record(kind, table[key], where, key)
    maneuvers = _table(table["maneuvers"], where, "maneuvers")
    _keys(maneuvers, required={"lane_offset", "speed_kmh"}, where=where, section="maneuvers")
    speeds = _table(maneuvers["speed_kmh"], where, "maneuvers.speed_kmh")
    vehicle = Vehicle(
        name=name,
        title=_text(table["title"], where, "title"),
        basis=_text(table["basis"], where, "basis"),
        speeds={
            key: _number(value, where, f"maneuvers.speed_kmh.{key}") / 3.6
            for key, value in speeds.items()
        },
        lane_offset=_number(maneuvers["lane_offset"], where, "maneuvers.lane_offset"),
        sources={
            key: _text(value, where, f"sources.{key}")
            for key, value in _table(table["sources"], where, "sources").items()
        },
        **parts,
    )
    for problem in problems(vehicle):
        raise CanrollError(f"{where}: {problem}")
    for section in (*_SECTIONS, *_OPTIONAL, "maneuvers"):
        for key in table.get(section, ()):
            if not vehicle.source(f"{section}.{key}"):
                raise CanrollError(f"{where}: {section}.{key} has no source: name it in [sources]")
    return vehicle


def _keys(
    table: Mapping[str, Any],
    *,
    required: set[str],
    where: str,
    section: str,
    optional: Collection[str] = (),
) -> None:
    at = f"[{section}] " if section else ""
    for key in table:
        if key not in required and key not in optional:
            near = get_close_matches(key, sorted(required - set(table)), n=1)
            hint = f", did you mean '{near[0]}'?" if near else ""
            raise CanrollError(f"{where}: {at}unknown key '{key}'{hint}")
    missing = sorted(required - set(table))
    if missing:
        raise CanrollError(f"{where}: {at}missing key '{missing[0]}'")


def _table(value: Any, where: str, section: str) -> Mapping[str, Any]:  # noqa: ANN401
    if not isinstance(value, Mapping):
        raise CanrollError(f"{where}: '{section}' must be a table")
    return value


def _text(value: Any, where: str, key: str) -> str:  # noqa: ANN401
    if not isinstance(value, str) or not value.strip():
        raise CanrollError(f"{where}: '{key}' must be a string")
    return value


def _number(value: Any, where: str, key: str) -> float:  # noqa: ANN401
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CanrollError(f"{where}: '{key}' must be a number, not {value!r}")
    return float(value)


def _record(kind: Any, value: Any, where: str, section: str) -> Any:  # noqa: ANN401
    table = _table(value, where, section)
    hints = get_type_hints(kind)
    _keys(table, required={field.name for field in fields(kind)}, where=where, section=section)
    return kind(
        **{key: _value(hints[key], item, where, f"{section}.{key}") for key, item in table.items()}
    )


def _value(kind: Any, value: Any, where: str, key: str) -> Any:  # noqa: ANN401
    if is_dataclass(kind):
        return _record(kind, value, where, key)
    if get_origin(kind) is tuple:
        if not isinstance(value, list):
            raise CanrollError(f"{where}: '{key}' must be a list of numbers")
        length = len(kind.__args__)
        if kind.__args__[-1] is not Ellipsis and len(value) != length:
            raise CanrollError(f"{where}: '{key}' must have {length} numbers, not {len(value)}")
        return tuple(_number(item, where, key) for item in value)
    return _number(value, where, key)
