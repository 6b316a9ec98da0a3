"""Records of runs as NumPy archives: each field of a dataclass is an entry of its name."""

import json
from collections.abc import Mapping
from typing import Any, TypeVar, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from canroll import documents
from firmware import subset
from firmware.calibration import Calibration
from gain_gen.calibration.record import fill
from plant_sim.world import archive
from plant_sim.world.spool import Table, as_columns

T = TypeVar("T")
Signals = Mapping[str, NDArray[np.float64]]
NAMES = "signal_names"
DEFAULTED = ("bus", "refused")
"""Fields that an archive may lack."""


def entries(record: object, prefix: str = "") -> dict[str, archive.Entry]:
    """Return the entries of a record; what is None has none."""
    made: dict[str, archive.Entry] = {}
    for name, hint in get_type_hints(type(record)).items():
        value = getattr(record, name)
        if hint == Signals:
            made[prefix + NAMES] = np.array(list(value))
            value = as_columns(value)
        elif isinstance(value, Calibration):
            integers = {
                field.name: getattr(value, field.name) for field in subset.fields(Calibration)
            }
            value = np.array(json.dumps(integers))
        elif isinstance(value, Mapping):
            value = np.array(json.dumps(dict(value)))
        if value is not None:
            made[prefix + name] = value if hint in (Signals, Table) else np.asarray(value)
    return made


def read(kind: type[T], stored: archive.Archive, prefix: str = "") -> T:
    """Return the record of a dataclass; a field without an entry has its default.

    Raises:
        canroll.errors.UNREADABLE: an entry is missing, or of another type.
    """
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(kind).items():
        entry = prefix + name
        if hint == Signals:
            values[name] = stored.signals(entry, map(str, stored.array(prefix + NAMES)))
        elif hint == Table:
            values[name] = stored.rows(entry)
        elif entry in stored or name not in DEFAULTED:
            values[name] = _value(stored.array(entry), hint)
    return kind(**values)


def _value(array: NDArray[Any], hint: Any) -> Any:  # noqa: ANN401
    if get_origin(hint) is np.ndarray:
        return array
    if hint is Calibration:
        return fill(documents.parse_json(str(array)))
    if get_origin(hint) is Mapping:
        return documents.parse_json(str(array))
    return hint(array) if isinstance(hint, type) else tuple(array.tolist())
