"""The shipped catalogue of faults: single and double, each with the reaction expected of it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canroll import documents
from canroll.errors import CanrollError, UnknownNameError, reason
from canroll.plant_sim.faults import kinds, parse
from canroll.plant_sim.nodes.actuators import command_signals
from canroll.reaction.fault_codes import MODES
from canroll.runs.result import Run

CATALOGUE = Path(__file__).with_name("catalogue.toml")
SINGLE, DOUBLE = "single", "double"
DETECTED, TOLERATED = "detected", "tolerated"
KEYS = ("name", "faults", "expect", "mode")


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """One entry of a catalogue.

    Attributes:
        name: what fails, in words.
        group: what it is that fails: "sensor signal", "actuator" and so on; "double".
        faults: the faults as :func:`canroll.plant_sim.faults.parse` reads them.
        expect: "detected", or "tolerated": no harm, detected or not.
        mode: mode that the ECU should go to; empty: any.
    """

    name: str
    group: str
    faults: str
    expect: str
    mode: str = ""


GROUPS = {
    kinds.SIGNAL: "sensor signal",
    kinds.MESSAGE: "message",
    kinds.ACTUATOR: "actuator",
    kinds.NODE: "node",
    kinds.BUS: "bus",
    kinds.ATTACKER: "attacker",
}


def entries(settings: Run, path: Path = CATALOGUE) -> tuple[CatalogueEntry, ...]:
    """Return the entries of a catalogue for the actuators of ``settings``.

    Raises:
        CanrollError: the file cannot be read, or an entry is wrong; it is named.
    """
    try:
        data = documents.toml(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"{path}: {reason(error)}") from error
    documents.refuse_unknown(data, (SINGLE, DOUBLE), f"{path}: key")
    words = placeholders(settings)
    if not data:
        raise CanrollError(f"{path}: no entry; write each as a table [[{SINGLE}]] or [[{DOUBLE}]]")
    return tuple(
        _entry(table, words, f"{path}: entry {number} of [[{kind}]]", kind)
        for kind in (SINGLE, DOUBLE)
        for number, table in enumerate(_tables(data, kind, path), 1)
    )


def placeholders(settings: Run) -> dict[str, str]:
    """Return what stands for the command and the limits of the actuators of ``settings``."""
    values = command_signals(settings.command)
    actuators = settings.vehicle.actuators
    limit = {
        "suspension": actuators.suspension.force_limit,
        "bars": actuators.bars.torque_limit,
        "dampers": actuators.dampers.current_limit,
        "valves": actuators.valves.current_limit,
    }[settings.actuator]
    return {
        "command": settings.command,
        "first": values[0],
        "last": values[-1],
        "push": f"{limit:g}",
        "pull": f"{-limit:g}",
    }


def _tables(data: Mapping[str, Any], key: str, path: Path) -> Iterator[Mapping[str, Any]]:
    tables = data.get(key, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise CanrollError(f"{path}: write each entry as a table [[{key}]]")
    yield from tables


def _entry(
    table: Mapping[str, Any], words: Mapping[str, str], what: str, kind: str
) -> CatalogueEntry:
    documents.refuse_unknown(table, KEYS, f"key of {what},")
    for key, value in table.items():
        if not isinstance(value, str):
            raise CanrollError(f"{what}: {key} must be text")
    for key in KEYS[:3]:
        if key not in table:
            raise CanrollError(f"{what}: {key} is missing")
    if table["expect"] not in (DETECTED, TOLERATED):
        raise UnknownNameError(f"{what}: reaction", table["expect"], (DETECTED, TOLERATED))
    mode = table.get("mode", "")
    if mode and mode not in MODES:
        raise UnknownNameError(f"{what}: mode", mode, MODES)
    text = table["faults"]
    for name, word in words.items():
        text = text.replace(f"{{{name}}}", word)
    try:
        faults = parse(text)
    except CanrollError as error:
        raise CanrollError(f"{what}: {error}") from error
    group = GROUPS[kinds.PLACES[faults[0].where]] if kind == SINGLE else DOUBLE
    return CatalogueEntry(table["name"], group, text, table["expect"], mode)
