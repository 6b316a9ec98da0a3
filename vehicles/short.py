"""Short vehicle files: a base with other numbers, and sections taken from another vehicle."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from canroll.errors import CanrollError
from canroll.vehicles import axle_files, fit_spread, tyre_files
from canroll.vehicles.model import WORDS, Vehicle
from canroll.vehicles.suspensions.tables import OF_FRONT, SECTION

GIVEN = "given by this file"
BODY = ("roll_inertia", "sprung_mass", "cg_height_above_roll_axis")
"""Numbers of the plant that an ``empty`` body of the base would contradict."""

_WITH = {"tyre": (tyre_files.SECTION,), "suspension": (SECTION,)}
"""Sections that come with one taken from another vehicle; the steering's tables with that."""


def is_short(table: Mapping[str, Any]) -> bool:
    """Whether a vehicle's table has a base, or sections named after another vehicle."""
    return "base" in table or any(
        isinstance(value, str) for key, value in table.items() if key not in WORDS
    )


def completed(
    table: Mapping[str, Any], read: Callable[[str], Vehicle], *, name: str, where: str
) -> dict[str, Any]:
    """Return the complete table of a short one.

    Every number has a source: that of the file, :data:`GIVEN`, or "of base NAME: …".

    Args:
        table: of the short file.
        read: returns the vehicle of a reference in it.
        name: of the vehicle, for its title.
        where: begins every error message.

    Raises:
        CanrollError: a reference that is no text, or to a vehicle that is none.
    """
    own = {key: value for key, value in table.items() if key != "base"}
    sources = own.pop("sources", {})
    if not isinstance(sources, Mapping):
        raise CanrollError(f"{where}: 'sources' must be a table")
    result: dict[str, Any] = {"sources": {}}
    if "base" in table:
        if not isinstance(table["base"], str):
            raise CanrollError(f"{where}: 'base' must be the name or file of a vehicle")
        base = read(table["base"])
        result = base.document
        result["title"] = f"{name}, based on {base.name}"
        result["basis"] = f"numbers of this file on those of {base.name}: {base.basis}"
        result["sources"] = _of(f"base {base.name}", base.sources)
        result = tyre_files.merged(result, own)
        plant = own.get("plant")
        if isinstance(plant, Mapping):
            if "design" not in own:
                del result["design"]
                result["sources"] = _without(result["sources"], "design")
            if "empty" not in own and any(key in plant for key in BODY):
                result.pop("empty", None)
                result["sources"] = _without(result["sources"], "empty")
    for key, value in own.items():
        if key in WORDS:
            result[key] = value
        elif isinstance(value, str):
            other = read(value)
            if key not in other.document:
                raise CanrollError(f"{where}: vehicle {value} has no section '{key}'")
            before = dict(result)
            for section in (key, *_WITH.get(key, ())):
                result.pop(section, None)
                if section in other.document:
                    result[section] = other.document[section]
                taken = {
                    part: text
                    for part, text in other.sources.items()
                    if part.partition(".")[0] == section
                }
                result["sources"] = _without(result["sources"], section) | _of(other.name, taken)
            if key == "steering":
                _steer(result, other.document, _of(other.name, other.sources))
            elif key == "suspension":
                _steer(result, before, before["sources"])
        else:
            merge = axle_files.merged if key == SECTION else _merged
            result[key] = merge(result.get(key), value)
            by_axle = key == SECTION and isinstance(value, Mapping)
            by_axle |= key == tyre_files.SECTION and tyre_files.is_complete(value)
            for path in (f"{key}.{axle}" for axle in value) if by_axle else _leaves(value, key):
                result["sources"][path] = _longest(sources, path) or GIVEN
    if fit_spread.SECTION in result and fit_spread.SECTION not in own:
        given = [path for key in own if key not in WORDS for path in _leaves(own[key], key)]
        spread = fit_spread.without(result.pop(fit_spread.SECTION), given)
        if spread is not None:
            result[fit_spread.SECTION] = spread
    return axle_files.without_following(result, own, where)


def _steer(result: dict[str, Any], of: Mapping[str, Any], sources: Mapping[str, str]) -> None:
    """Give a vehicle's table what the axles of another table say of the steering."""
    axles = axle_files.with_steering(result.pop(SECTION, {}), of.get(SECTION, {}))
    if axles:
        result[SECTION] = axles
    front, known = f"{SECTION}.front", result["sources"]
    for key in OF_FRONT:
        known.pop(f"{front}.{key}", None)
        if key in axles.get("front", {}):
            source = _longest(sources, f"{front}.{key}")
            # an axle of these alone has their source
            known[f"{front}.{key}" if _longest(known, front) else front] = source


def _of(origin: str, sources: Mapping[str, str]) -> dict[str, str]:
    return {key: f"of {origin}: {text}" for key, text in sources.items()}


def _without(sources: Mapping[str, str], section: str) -> dict[str, str]:
    return {key: text for key, text in sources.items() if key.partition(".")[0] != section}


def _merged(base: Any, given: Any) -> Any:  # noqa: ANN401
    """Return the base's table with the given keys; what is no table replaces the base's."""
    if not isinstance(base, Mapping) or not isinstance(given, Mapping):
        return given
    return {**base, **{key: _merged(base.get(key), value) for key, value in given.items()}}


def _leaves(value: Any, path: str) -> Iterator[str]:  # noqa: ANN401
    """Paths of all numbers and lists of a table."""
    if not isinstance(value, Mapping):
        yield path
        return
    for key, item in value.items():
        yield from _leaves(item, f"{path}.{key}")


def _longest(sources: Mapping[str, Any], path: str) -> Any:  # noqa: ANN401
    parts = path.split(".")
    for length in range(len(parts), 0, -1):
        text = sources.get(".".join(parts[:length]))
        if text is not None:
            return text
    return ""
