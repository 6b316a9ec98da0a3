"""The description of an FMU, and the check that a map fits it."""

import math
import zipfile
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError, MissingExtraError, reason
from canroll.extensions.exchange.fmi.map_file import LONGEST_STEP_MS, PlantMap, Wire
from canroll.extensions.exchange.fmi.quantities import DERIVED, INPUTS, OUTPUTS, UNITS, spelt

NANOSECONDS, MILLISECOND = 10**9, 10**6
FLOATS = ("Real", "Float64")
SETTERS = {
    "Real": "setReal",
    "Integer": "setInteger",
    "Boolean": "setBoolean",
    "String": "setString",
    **{kind: f"set{kind}" for kind in ("Float64", "Int32", "Int64", "UInt8")},
}
"""How FMPy sets a variable of each type."""
WHOLE = ("Integer", "Int32", "Int64", "UInt8")
SETTABLE = ("exact", "approx")
MOST_BYTES = 64 << 20
"""Size of an unpacked description: some 300 000 variables of 200 bytes."""
DESCRIPTIONS = ("modelDescription.xml", "sources/buildDescription.xml")


@dataclass(frozen=True, slots=True, kw_only=True)
class Fmu:
    """What of an FMU the co-simulation needs.

    Attributes:
        version: 2 or 3.
        identifier: of its library.
        token: its GUID or instantiation token.
        references: value reference of each mapped variable by name.
        types: type of each mapped variable by name.
        factors: factor from the unit of each wire's variable to the SI unit, by variable.
    """

    version: int
    identifier: str
    token: str
    references: dict[str, int]
    types: dict[str, str]
    factors: dict[str, float]


def read(path: Path, plant_map: PlantMap) -> Fmu:
    """Read the description of the FMU at ``path`` and check that ``plant_map`` fits it.

    Raises:
        MissingExtraError: FMPy is not installed.
        CanrollError: not an FMU for co-simulation, a description of more than
            :data:`MOST_BYTES`, a variable that it does not have, another unit,
            or a communication step that it cannot do; the message names the remedy.
    """
    if find_spec("fmpy") is None:
        raise MissingExtraError("--plant with an FMU", "fmi")
    import fmpy  # noqa: PLC0415 - an extra

    try:
        _check_sizes(path)
        described = fmpy.read_model_description(str(path))
    except Exception as error:  # FMPy raises what its parsers raise
        raise CanrollError(f"{path}: not a valid FMU: {reason(error)}") from error
    version = int(described.fmiVersion.split(".")[0])
    if version not in (2, 3) or described.coSimulation is None:
        raise CanrollError(
            f"{path}: the plant must be an FMU for co-simulation of FMI 2.0 or 3.0: export it so"
        )
    if described.coSimulation.needsExecutionTool:
        raise CanrollError(
            f"{path}: needs the tool that made it to run: export it with its own solver"
        )
    _check_step(path, described, plant_map)
    known = {variable.name: variable for variable in described.modelVariables}
    used: dict[str, Any] = {}
    factors: dict[str, float] = {}
    places = (("inputs", plant_map.inputs), ("outputs", plant_map.outputs))
    for table, wires in places:
        for wire in wires:
            where = f"{plant_map.path}: {table}"
            used[wire.variable] = _variable(path, known, wire.variable, where)
            _check_end(where, used[wire.variable], table)
            factors[wire.variable] = _factor(where, used[wire.variable], wire)
    for name, value in plant_map.start:
        where = f"{plant_map.path}: start"
        used[name] = _variable(path, known, name, where)
        _check_start(where, used[name], value)
        if isinstance(value, Wire):
            factors[name] = _factor(where, used[name], value)
    return Fmu(
        version=version,
        identifier=described.coSimulation.modelIdentifier,
        token=described.guid if version == 2 else described.instantiationToken,
        references={name: entry.valueReference for name, entry in used.items()},
        types={name: entry.type for name, entry in used.items()},
        factors=factors,
    )


def _check_sizes(path: Path) -> None:
    """Raise ValueError where a few bytes of the archive unpack to more than the memory takes."""
    with zipfile.ZipFile(path) as archive:
        for each in archive.infolist():
            if each.filename in DESCRIPTIONS and each.file_size > MOST_BYTES:
                raise ValueError(f"{each.filename} is larger than {MOST_BYTES >> 20} MB")


def _check_step(path: Path, described: Any, plant_map: PlantMap) -> None:  # noqa: ANN401
    """Refuse a communication step that the FMU cannot do."""
    able = described.coSimulation
    fixed, why = able.fixedInternalStepSize, "its fixed internal step"
    if fixed is None and not able.canHandleVariableCommunicationStepSize:
        default = described.defaultExperiment
        fixed = None if default is None else default.stepSize
        why = "the step that it names and cannot vary"
    if fixed is None:
        return
    exact = float(fixed) * NANOSECONDS
    if not math.isfinite(exact):
        raise CanrollError(f"{path}: {why} is {fixed} s: export it with another step")
    theirs = round(exact)
    if theirs > 0 and plant_map.step_ms * MILLISECOND % theirs == 0:
        return
    suits = math.lcm(MILLISECOND, theirs) // MILLISECOND
    remedy = f"write step_ms = {suits} in {plant_map.path}"
    if not 1 <= suits <= LONGEST_STEP_MS:
        remedy = f"no whole number of up to {LONGEST_STEP_MS} ms is: export it with another step"
    raise CanrollError(
        f"{path}: a communication step of {plant_map.step_ms} ms is not a multiple of "
        f"{1e3 * float(fixed):g} ms, {why}: {remedy}"
    )


def _variable(path: Path, known: dict[str, Any], name: str, where: str) -> Any:  # noqa: ANN401
    if name not in known:
        near = get_close_matches(name, known, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else "'fmpy info' lists its variables"
        raise CanrollError(f"{where}: {path.name} has no variable '{name}': {hint}")
    return known[name]


def _check_end(where: str, variable: Any, table: str) -> None:  # noqa: ANN401
    """Refuse a variable that is not settable at each step, or not readable."""
    if variable.type not in FLOATS or variable.dimensions:
        kind = f"an array of {variable.type}" if variable.dimensions else variable.type
        raise CanrollError(f"{where}: {variable.name} is {kind}, it must be a real scalar")
    if table == "inputs" and variable.causality != "input" and variable.variability != "tunable":
        raise CanrollError(
            f"{where}: {variable.name} is no input of the FMU ({variable.causality}): "
            "what is set once belongs into [start]"
        )


def _check_start(where: str, variable: Any, value: object) -> None:  # noqa: ANN401
    name, kind = variable.name, variable.type
    settable = variable.causality in ("parameter", "input") or variable.initial in SETTABLE
    if not settable or variable.variability == "constant" or variable.dimensions:
        raise CanrollError(f"{where}: {name} cannot be set before the start ({variable.causality})")
    if kind not in SETTERS:
        raise CanrollError(f"{where}: {name} is {kind}, which cannot be set here")
    fits = (
        isinstance(value, Wire)
        if kind in FLOATS and isinstance(value, Wire)
        else isinstance(value, str)
        if kind == "String"
        else isinstance(value, bool)
        if kind == "Boolean"
        else isinstance(value, int) and not isinstance(value, bool)
        if kind in WHOLE
        else isinstance(value, int | float) and not isinstance(value, bool)
    )
    if not fits:
        raise CanrollError(f"{where}: {name} is {kind}, {value!r} is not")


def _factor(where: str, variable: Any, wire: Wire) -> float:  # noqa: ANN401
    """Return the factor from the unit of the variable to the SI unit of its quantity."""
    if not wire.quantity:
        return 1.0
    si = _unit_of(wire.quantity)
    stated = si if wire.unit is None else wire.unit
    if UNITS[stated][0] != UNITS[si][0]:
        raise CanrollError(
            f"{where}: {wire.quantity} cannot be in {stated or 'no unit'}, its SI unit is {si}"
        )
    declared = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
    if declared is not None and spelt(declared) != stated and UNITS[stated] != _known(declared):
        raise CanrollError(
            f"{where}: {variable.name} is in {declared}, the map has {stated or 'no unit'}: "
            f'write {{ from = …, unit = "{declared}" }}'
        )
    return UNITS[stated][1]


def _unit_of(quantity: str) -> str:
    if quantity in DERIVED:
        return DERIVED[quantity][0]
    return (INPUTS.get(quantity) or OUTPUTS[quantity])[1]


def _known(unit: str) -> tuple[str, float] | None:
    return UNITS.get(spelt(unit))
