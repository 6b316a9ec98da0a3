"""A vehicle with other numbers, by the dotted keys of its file."""

from collections.abc import Iterator, Mapping
from copy import deepcopy
from typing import Any

from canroll.errors import UnknownNameError
from canroll.vehicles import axle_files, fit_spread
from canroll.vehicles.load import from_table
from canroll.vehicles.model import WORDS, Vehicle
from canroll.vehicles.plausible import KEYS

GIVEN = "given as a change"


def changed(vehicle: Vehicle, changes: Mapping[str, Any], *, name: str = "") -> Vehicle:
    """Return ``vehicle`` with ``changes``: see :meth:`canroll.vehicles.Vehicle.replace`.

    The plausibility of keys other than the changed ones is not checked again.
    """
    table = deepcopy(vehicle.document)
    known = list(
        _keys(
            {key: part for key, part in table.items() if key not in (*WORDS, fit_spread.SECTION)},
            "",
        )
    )
    for key, value in changes.items():
        axle_files.check_change(vehicle, key)
        if key not in known:
            raise UnknownNameError("key of a vehicle", key, known)
        _put(table, key, value)
        table["sources"][key] = GIVEN
        section, _, part = key.partition(".")
        if (
            section == "plant"
            and vehicle.design == vehicle.plant
            and f"design.{part}" not in changes
        ):
            _put(table, f"design.{part}", value)
            table["sources"][f"design.{part}"] = GIVEN
    if vehicle.fit is not None:
        spread = fit_spread.without(table.pop(fit_spread.SECTION), changes)
        if spread is not None:
            table[fit_spread.SECTION] = spread
    words = ", ".join(f"{key}={_text(value)}" for key, value in changes.items())
    name = name or (f"{vehicle.name} with {words}" if words else vehicle.name)
    untouched = set(KEYS) - set(changes)
    return from_table(table, name=name, where=f"vehicle {name}", unusual=untouched)


def _keys(table: Mapping[str, Any], path: str) -> Iterator[str]:
    for key, item in table.items():
        if isinstance(item, Mapping):
            yield from _keys(item, f"{path}{key}.")
        else:
            yield f"{path}{key}"


def _put(table: dict[str, Any], key: str, value: Any) -> None:  # noqa: ANN401
    *path, last = key.split(".")
    for part in path:
        table = table[part]
    table[last] = value


def _text(value: Any) -> str:  # noqa: ANN401
    return f"{value:g}" if isinstance(value, int | float) else str(value)
