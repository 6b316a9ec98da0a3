"""Reader of vehicles from TOML: presets by name, users' files by path."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_origin, get_type_hints

from canroll.arguments import checked
from canroll.documents import parse_toml, refuse_other
from canroll.documents import text as read_text
from canroll.errors import CanrollError, UnknownNameError, reason
from canroll.vehicles import axle_files, fit_spread, tyre_files
from canroll.vehicles.axle_files import followed
from canroll.vehicles.check import problems, signs
from canroll.vehicles.model import SCHEMA, Aerodynamics, Empty, Vehicle
from canroll.vehicles.plausible import implausible, outside
from canroll.vehicles.short import completed, is_short
from canroll.vehicles.suspensions import tables

_FOLDER = Path(__file__).parent
_SECTIONS = (
    # before the design, which may be taken from it
    "plant",
    "design",
    "geometry",
    "mass",
    "suspension",
    "tyre",
    "steering",
    "driver",
    "actuators",
    "sensors",
)
_OPTIONAL = {"empty": Empty, "aerodynamics": Aerodynamics}


def names() -> list[str]:
    """The names of the presets, sorted."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


@checked
def load(vehicle: Vehicle | Path | str | Mapping[str, Any]) -> Vehicle:
    """Return a vehicle: the preset of that name, that of the file, or the given one, checked.

    Args:
        vehicle: a name of :func:`names`, a path (anything that ends in ``.toml`` or contains a
            separator), the table of a vehicle file, or a vehicle, as derived from another one by
            :meth:`canroll.vehicles.Vehicle.replace`. Files and tables may be short: see
            :mod:`canroll.vehicles.short`; a table's references are relative to the current folder.

    Raises:
        UnknownNameError: there is no preset of that name; the message suggests the nearest.
        CanrollError: the file cannot be read, is not a vehicle, or describes an impossible or
            implausible one.
    """
    if isinstance(vehicle, Vehicle):
        where = f"vehicle {vehicle.name}"
        again = from_table(vehicle.document, name=vehicle.name, where=where)
        return replace(again, file=vehicle.file)
    if isinstance(vehicle, Mapping):
        return _checked(vehicle, "vehicle", "vehicle", Path(), ())
    return _load_file(vehicle, Path(), ())


def _load_file(vehicle: Path | str, folder: Path, users: tuple[Path, ...]) -> Vehicle:
    """Return the vehicle of a name, or of a path in ``folder``, used by the files ``users``."""
    text = str(vehicle)
    file = ""
    if isinstance(vehicle, Path) or _is_path(text):
        path, file = folder / vehicle, text
    else:
        path = _FOLDER / f"{text}.toml"
        if text not in names():
            own = f"{text}.toml"
            near = [own] if (folder / own).is_file() else ()
            raise UnknownNameError("vehicle", text, names(), near=near)
    if path.resolve() in users:
        raise CanrollError(f"{path}: its base refers back to it")
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
    if "base" not in table:
        refuse_other(table, "tyre", str(path))
    users = (*users, path.resolve())
    return replace(_checked(table, path.stem, str(path), path.parent, users), file=file)


def _checked(
    table: Mapping[str, Any], name: str, where: str, folder: Path, users: tuple[Path, ...]
) -> Vehicle:
    """Build the vehicle of a file's table, which may be short, and check it."""
    table = dict(table)
    unusual = table.pop("unusual", [])
    if not isinstance(unusual, list) or not all(isinstance(key, str) for key in unusual):
        raise CanrollError(f"{where}: 'unusual' must be a list of keys, as 'plant.roll_damping'")
    table = axle_files.embedded(tyre_files.embedded(table, folder, where), folder, where)
    if is_short(table):
        origins: list[Vehicle] = []

        def read(reference: str) -> Vehicle:
            try:
                origins.append(_load_file(reference, folder, users))
            except UnknownNameError as error:
                raise CanrollError(f"{where}: {error}") from error
            return origins[-1]

        table = completed(table, read, name=name, where=where)
        unusual = [*unusual, *(key for other in origins for key in _meant(other, table))]
    return from_table(table, name=name, where=where, unusual=unusual)


def _meant(other: Vehicle, table: Mapping[str, Any]) -> Iterator[str]:
    """Keys of strange numbers that a vehicle's table has from another vehicle, which means them.

    One that follows from tables stands in neither.
    """
    for key in outside(other):
        section, name = key.split(".")
        numbers = table.get(section)
        if isinstance(numbers, Mapping) and numbers.get(name) == other.document[section].get(name):
            yield key


def embedded(table: object, *, reference: str, fingerprint: object, where: str) -> Vehicle:
    """Return the vehicle whose document is part of another file.

    Args:
        table: its :attr:`canroll.vehicles.model.Vehicle.document`.
        reference: its name or file.
        fingerprint: its fingerprint when it was written.
        where: file and key, which begin every error message.

    Raises:
        CanrollError: it is not a vehicle, describes an impossible one, or was edited.
    """
    file = reference if _is_path(reference) else ""
    name = Path(file).stem or reference
    vehicle = from_table(_table(table, where, "vehicle"), name=name, where=where)
    if vehicle.fingerprint != fingerprint:
        raise CanrollError(
            f"{where}: the fingerprint does not match the vehicle's numbers: the file was edited; "
            "create it again"
        )
    return replace(vehicle, file=file)


def note_of_change(vehicle: Vehicle, of: str) -> str:
    """Return a note if the file or preset of an embedded vehicle has other numbers, else "".

    Args:
        vehicle: the vehicle; its file need not exist.
        of: what it is embedded in, such as "calibration".
    """
    try:
        known = load(vehicle.reference)
    except CanrollError:
        return ""
    if known.fingerprint == vehicle.fingerprint:
        return ""
    return (
        f"vehicle {vehicle.reference} has other numbers than the {of}: those of the {of} are used"
    )


def from_table(
    table: Mapping[str, Any],
    *,
    name: str,
    where: str = "vehicle",
    unusual: Collection[str] | None = None,
) -> Vehicle:
    """Build a vehicle from a complete table.

    Args:
        table: of a vehicle file or :attr:`canroll.vehicles.Vehicle.document`; without ``design`` it
            is the plant's.
        name: of the vehicle.
        where: begins every error message.
        unusual: keys that may be implausible; None: every key.

    Raises:
        CanrollError: it is not a vehicle, or describes an impossible or implausible one.
    """
    if "design" not in table and "plant" in table:
        sources = _table(table.get("sources", {}), where, "sources")
        equal = {"design": "equal to the plant"}
        table = {**table, "design": table["plant"], "sources": {**equal, **sources}}
    _keys(
        table,
        required={"schema", "title", "basis", "maneuvers", "sources", *_SECTIONS},
        optional={*_OPTIONAL, tyre_files.SECTION, tables.SECTION, fit_spread.SECTION},
        where=where,
        section="",
    )
    if table["schema"] != SCHEMA:
        raise CanrollError(f"{where}: schema {table['schema']!r}, but this version reads {SCHEMA}")
    hints = get_type_hints(Vehicle)
    parts: dict[str, Any] = {}
    given = table
    if tables.SECTION in table:
        parts[tables.SECTION] = axle_files.of_section(table[tables.SECTION], where)
        table = axle_files.provisional(table, parts[tables.SECTION], where)
    sections = {key: table[key] for key in _SECTIONS}
    if tyre_files.SECTION in table:
        files = tyre_files.section(table[tyre_files.SECTION], where)
        parts[tyre_files.SECTION] = files
        sections["tyre"] = tyre_files.provisional(
            _table(table["tyre"], where, "tyre"), files, where
        )
    parts |= {key: _record(hints[key], sections[key], where, key) for key in _SECTIONS}
    for key, kind in _OPTIONAL.items():
        if key in table:
            parts[key] = _record(kind, table[key], where, key)
    if fit_spread.SECTION in table:
        parts[fit_spread.SECTION] = fit_spread.of_section(table[fit_spread.SECTION], where)
    maneuvers = _table(table["maneuvers"], where, "maneuvers")
    _keys(maneuvers, required={"lane_offset", "speed_kmh"}, where=where, section="maneuvers")
    speeds = _table(maneuvers["speed_kmh"], where, "maneuvers.speed_kmh")
    vehicle = followed(
        Vehicle(
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
            }
            | axle_files.sources(parts.get(tables.SECTION)),
            **parts,
        )
    )
    if unusual is not None and not any(signs(vehicle)):
        for problem in implausible(vehicle, unusual):
            raise CanrollError(f"{where}: {problem}")
    for problem in problems(vehicle):
        raise CanrollError(f"{where}: {problem}")
    for key in () if vehicle.fit is None else vehicle.fit.names:
        try:
            if key.partition(".")[0] not in (*_SECTIONS, *_OPTIONAL):
                raise ValueError(key)
            fit_spread.value_of(vehicle, key)
            axle_files.check_change(vehicle, key)
        except CanrollError as error:
            raise CanrollError(f"{where}: fit.names: {error}") from error
        except (AttributeError, IndexError, TypeError, ValueError) as error:
            raise CanrollError(f"{where}: fit.names: the vehicle has no number '{key}'") from error
    for section in (*_SECTIONS, *_OPTIONAL, tyre_files.SECTION, tables.SECTION, "maneuvers"):
        for key in given.get(section, ()):
            if not vehicle.source(f"{section}.{key}"):
                raise CanrollError(f"{where}: {section}.{key} has no source: name it in [sources]")
    return vehicle


def _is_path(text: str) -> bool:
    return text.endswith(".toml") or "/" in text or "\\" in text


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
