"""A user's network as a TOML file: rates, load, gateway, and the frames that carry our signals.

See docs/file-formats.md, "A network". Paths in it are relative to it.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from canroll.errors import CanrollError, UnknownNameError
from plant_sim import buses
from plant_sim.buses.profile import BusProfile, accept

KEYS: Final = {
    "schema": int,
    "bitrate": int,
    "data_bitrate": int,
    "load": float,
    "above": float,
    "bit_error_rate": float,
    "gateway_ms": list,
    "traffic": str,
    "dbc": str,
    "map": str,
}
_REQUIRED: Final = ("schema", "bitrate")
_DEFAULT_LOAD: Final = 0.5


def load_profile(
    name: str, dbc: str | Path | None = None, map_file: str | Path | None = None
) -> BusProfile:
    """Return the bus profile ``name``, or the network in the file of that name.

    Args:
        name: of a profile, of a ``.toml`` file, or of a bus log.
        dbc: the frames that carry our signals, instead of the profile's own.
        map_file: says which signal of ``dbc`` is which field.

    Raises:
        UnknownNameError: there is no such profile.
        CanrollError: an extension's profile or a file that cannot be used.
    """
    profile = buses.load_profile(name)
    if dbc is None or map_file is None:
        return profile
    for path in (dbc, map_file):
        if not Path(path).is_file():
            raise CanrollError(f"{path}: no such file")
    return replace(profile, dbc=Path(dbc), map_file=Path(map_file))


def is_network(name: str) -> bool:
    """Return whether ``name`` is a built-in or installed bus, or a TOML file with a network."""
    path = Path(name)
    if path.suffix.lower() != ".toml":
        return name in buses.BUSES
    try:
        return "schema" in tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return False


def read_profile(name: str) -> BusProfile:
    """Return the network that the file ``name`` describes.

    Raises:
        CanrollError: the file cannot be read, or a key says something that cannot be.
    """
    path = Path(name)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise CanrollError(f"{path}: not a readable network: {error}") from error
    if "message" in table:
        raise CanrollError(f"{path}: a traffic set is for 'canroll bus'; a network has no messages")
    for key in table:
        if key not in KEYS:
            raise UnknownNameError(f"key in {path}", key, KEYS)
    for key in _REQUIRED:
        if key not in table:
            raise CanrollError(f"{path}: '{key}' is missing")
    for key, value in table.items():
        wanted = (int, float) if KEYS[key] is float else KEYS[key]
        if not isinstance(value, wanted) or isinstance(value, bool):
            raise CanrollError(f"{path}: {key} = {value!r}: must be {_NAMES[KEYS[key]]}")
    if table["schema"] != 1:
        raise CanrollError(f"{path}: schema must be 1, not {table['schema']}")
    if ("dbc" in table) != ("map" in table):
        raise CanrollError(f"{path}: dbc and map require each other")
    if "traffic" in table and ("load" in table or "above" in table or "gateway_ms" in table):
        raise CanrollError(
            f"{path}: traffic says what is on the one segment: omit load, above and gateway_ms"
        )
    profile = BusProfile(
        name=path.stem,
        bitrate=table["bitrate"],
        load=float(table.get("load", _DEFAULT_LOAD)),
        above=float(table.get("above", 0.5)),
        gateway_ms=_gateway(table, path),
        data_bitrate=table.get("data_bitrate", 0),
        bit_error_rate=float(table.get("bit_error_rate", 0.0)),
        dbc=_beside(path, table, "dbc"),
        map_file=_beside(path, table, "map"),
        traffic=_beside(path, table, "traffic"),
    )
    return accept(str(path), profile)


_NAMES: Final = {
    int: "a whole number",
    float: "a number",
    str: "a file name",
    list: "two times, such as [5, 10]",
}


def _gateway(table: Mapping[str, Any], path: Path) -> tuple[float, float] | None:
    given = table.get("gateway_ms")
    if given is None:
        return None
    if len(given) != 2 or any(isinstance(t, bool) or not isinstance(t, int | float) for t in given):
        raise CanrollError(f"{path}: gateway_ms = {given!r}: must be {_NAMES[list]}")
    low, high = given
    return float(low), float(high)


def _beside(path: Path, table: Mapping[str, Any], key: str) -> Path | None:
    if key not in table:
        return None
    found = path.parent / str(table[key])
    if not found.is_file():
        raise CanrollError(f"{path}: {key} = '{table[key]}': no such file")
    return found
