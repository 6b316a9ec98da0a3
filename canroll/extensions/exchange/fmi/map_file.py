"""The map of an FMU: which of its variables are which quantities of the plant (TOML)."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeGuard

from canroll import documents
from canroll.errors import CanrollError, UnknownNameError, reason
from canroll.extensions.exchange.fmi.quantities import (
    DERIVED,
    INPUTS,
    OUTPUTS,
    REQUIRED,
    UNITS,
    spelt,
)

KEYS = ("step_ms", "ignored", "inputs", "outputs", "start")
LONGEST_STEP_MS = 20
SPEED = "speed"
"""Under [start]: the manoeuvre's entry speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wire:
    """A variable joined with a quantity: variable = scale · quantity / unit + offset.

    ``unit`` is that of the variable, None for the SI unit of the quantity; a constant has no
    quantity, and the value ``offset``. Of an output the variable, scaled and shifted, is the
    quantity.
    """

    variable: str
    quantity: str = ""
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantMap:
    """The map of one FMU; ``step_ms`` is the communication step.

    ``inputs`` and ``outputs`` as :class:`Wire`; ``start`` has values of variables, or
    :data:`SPEED`; ``ignored`` names inputs that the FMU does without.
    """

    path: Path
    inputs: tuple[Wire, ...]
    outputs: tuple[Wire, ...]
    start: tuple[tuple[str, bool | int | float | str | Wire], ...]
    ignored: frozenset[str]
    step_ms: int

    @property
    def given(self) -> frozenset[str]:
        """The inputs that reach the FMU or are ignored."""
        quantities = set(self.ignored)
        for wire in self.inputs:
            quantities.update(
                DERIVED[wire.quantity][1] if wire.quantity in DERIVED else [wire.quantity]
            )
        return frozenset(quantities)


def read(path: Path) -> PlantMap:
    """Read the map at ``path``.

    Raises:
        CanrollError: unreadable, or an invalid entry; the message names it.
    """
    try:
        table = documents.toml(path)
    except FileNotFoundError as error:
        raise CanrollError(
            f"{path}: no such file: an FMU needs a map of its variables, as docs/exchange.md has it"
        ) from error
    except (OSError, ValueError) as error:
        raise CanrollError(f"{path}: {reason(error)}") from error
    documents.refuse_unknown(table, KEYS, f"key in {path}")
    inputs = [
        _input(name, value, (*INPUTS, *DERIVED), f"{path}: inputs.{name}")
        for name, value in _table(table, "inputs", path).items()
    ]
    outputs = [
        replace(_wire(value, f"{path}: outputs.{name}"), quantity=name)
        for name, value in _table(table, "outputs", path).items()
    ]
    documents.refuse_unknown([wire.quantity for wire in outputs], OUTPUTS, f"output in {path}")
    missing = sorted(set(REQUIRED) - {wire.quantity for wire in outputs})
    if missing:
        raise CanrollError(
            f"{path}: driver and sensors need {', '.join(missing)}: add them to [outputs]"
        )
    ignored = table.get("ignored", [])
    if not isinstance(ignored, list) or not all(isinstance(name, str) for name in ignored):
        raise CanrollError(f"{path}: ignored must be a list of names of inputs")
    documents.refuse_unknown(ignored, INPUTS, f"input in {path}")
    return PlantMap(
        path=path,
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        start=tuple(_start(table, path)),
        ignored=frozenset(ignored),
        step_ms=_step(table.get("step_ms", 1), path),
    )


def _table(table: Mapping[str, Any], key: str, path: Path) -> Mapping[str, Any]:
    content = table.get(key, {})
    if not isinstance(content, dict):
        raise CanrollError(f"{path}: {key} must be a table, [{key}]")
    return content


def _input(variable: str, entry: object, known: Iterable[str], where: str) -> Wire:
    """Return what drives ``variable``: a quantity of ``known``, or a constant."""
    if _is_number(entry):
        return Wire(variable=variable, offset=_number(entry, where))
    wire = _wire(entry, where)
    if wire.variable not in known:
        raise UnknownNameError(f"input of {where}", wire.variable, known)
    return replace(wire, variable=variable, quantity=wire.variable)


def _wire(entry: object, where: str) -> Wire:
    """Return the wire of an entry, a name or a table with ``from``, which is its ``variable``."""
    if isinstance(entry, str):
        entry = {"from": entry}
    if not isinstance(entry, dict) or not isinstance(entry.get("from"), str):
        raise CanrollError(f'{where} must be a name, or {{ from = "NAME", unit = … }}')
    documents.refuse_unknown(entry, ("from", "unit", "scale", "offset"), f"key of {where}")
    unit = entry.get("unit")
    if unit is not None and (not isinstance(unit, str) or spelt(unit) not in UNITS):
        raise UnknownNameError(f"unit of {where}", str(unit), tuple(UNITS))
    scale = _number(entry.get("scale", 1.0), f"{where}: scale")
    if scale == 0.0:
        raise CanrollError(f"{where}: scale must not be 0")
    return Wire(
        variable=entry["from"],
        unit=None if unit is None else spelt(unit),
        scale=scale,
        offset=_number(entry.get("offset", 0.0), f"{where}: offset"),
    )


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(value: object, where: str) -> float:
    if not _is_number(value) or not math.isfinite(value):
        raise CanrollError(f"{where} must be a finite number, got {value!r}")
    return float(value)


def _start(
    table: Mapping[str, Any], path: Path
) -> Iterable[tuple[str, bool | int | float | str | Wire]]:
    for name, value in _table(table, "start", path).items():
        where = f"{path}: start.{name}"
        if value == SPEED or isinstance(value, dict):
            yield name, _input(name, value, (SPEED,), where)
        elif isinstance(value, bool | str):
            yield name, value
        else:
            _number(value, where)
            yield name, value


def _step(value: object, path: Path) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= LONGEST_STEP_MS:
        raise CanrollError(
            f"{path}: step_ms must be a whole number of 1 to {LONGEST_STEP_MS} ms, got {value!r}"
        )
    return value
