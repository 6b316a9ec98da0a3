"""Columns of numbers from a CSV file or a table of a vehicle file, in SI units.

A header names each column and its unit in brackets: ``compression [mm], force [N]``. Numbers of a
CSV are separated by commas, semicolons (with a decimal comma or point) or tabs; ``#`` begins a
comment.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan, pi
from pathlib import Path
from typing import Any

from canroll.documents import text
from canroll.errors import CanrollError, UnknownNameError, reason

UNITS: dict[str, dict[str, float]] = {
    "m": {"m": 1.0, "cm": 0.01, "mm": 1e-3},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3},
    "N": {"N": 1.0, "kN": 1e3},
    "N·m": {"N·m": 1.0, "Nm": 1.0, "N*m": 1.0, "kN·m": 1e3, "kNm": 1e3},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": pi / 180, "°": pi / 180, "min": pi / 10800},
    "": {"": 1.0, "1": 1.0, "-": 1.0},
}
"""Names of units by the SI unit of a quantity, with their size in it."""
MOST_ROWS = 200
"""Of a table."""
_HEAD = re.compile(r"([^\[(]+?)\s*(?:[\[(]\s*(.*?)\s*[\])])?")


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns by name, SI units; ``place`` and ``lines`` name a row in messages."""

    values: dict[str, tuple[float, ...]]
    place: str
    lines: tuple[int, ...] = ()

    def at(self, row: int) -> str:
        """Where a row is: the file and its line, or the number of the row."""
        if self.lines:
            return f"{self.place}, line {self.lines[row]}"
        return f"{self.place}, row {row + 1}"


def inline(table: Mapping[str, Any], units: Mapping[str, str], place: str) -> Columns:
    """Return the columns of a table whose keys are headers and whose values are lists.

    Args:
        table: of a vehicle file.
        units: SI unit of each known column, by name.
        place: begins every error message.

    Raises:
        CanrollError: not such a table.
    """
    values: dict[str, tuple[float, ...]] = {}
    for head, numbers in table.items():
        name, size = _column(head, units, place)
        if not isinstance(numbers, Sequence) or isinstance(numbers, str):
            raise CanrollError(f"{place}: {head} must be a list of numbers")
        for row, number in enumerate(numbers):
            if isinstance(number, bool) or not isinstance(number, int | float):
                raise CanrollError(f"{place}, row {row + 1}: {number!r} is not a number")
        if name in values:
            raise CanrollError(f"{place}: column {name} is there twice")
        values[name] = tuple(_in_si(float(number), size) for number in numbers)
    lengths = {name: len(column) for name, column in values.items()}
    if len(set(lengths.values())) > 1:
        shown = ", ".join(f"{length} of {name}" for name, length in lengths.items())
        raise CanrollError(f"{place}: {shown}: all columns need as many numbers")
    columns = Columns(values, place)
    _check_rows(columns)
    return columns


def read(path: Path, units: Mapping[str, str]) -> Columns:
    """Return the columns of a CSV file.

    Args:
        path: the file.
        units: SI unit of each known column, by name.

    Raises:
        CanrollError: it cannot be read or is no such table; the message has file and line.
    """
    try:
        content = text(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"cannot read table {path}: {reason(error)}") from error
    rows = [
        (number, line)
        for number, raw in enumerate(content.splitlines(), 1)
        if (line := raw.partition("#")[0].strip())
    ]
    if not rows:
        raise CanrollError(f"{path}: empty file")
    (number, line), *rows = rows
    mark = next((each for each in (";", "\t") if each in line), ",")
    heads = [_column(head, units, f"{path}, line {number}") for head in line.split(mark)]
    names = [name for name, _ in heads]
    for name in names:
        if names.count(name) > 1:
            raise CanrollError(f"{path}, line {number}: column {name} is there twice")
    values: dict[str, list[float]] = {name: [] for name in names}
    for number, line in rows:
        cells = line.split(mark)
        if len(cells) != len(heads):
            raise CanrollError(
                f"{path}, line {number}: {len(cells)} numbers for {len(heads)} columns"
            )
        for (name, size), cell in zip(heads, cells, strict=True):
            values[name].append(_number(cell, size, f"{path}, line {number}", mark))
    columns = Columns(
        {name: tuple(column) for name, column in values.items()},
        str(path),
        tuple(number for number, _ in rows),
    )
    _check_rows(columns)
    return columns


def _column(head: str, units: Mapping[str, str], place: str) -> tuple[str, float]:
    """Name of a column and the size of its unit."""
    match = _HEAD.fullmatch(head.strip())
    name, unit = (match.group(1), match.group(2) or "") if match else (head.strip(), "")
    name = name.strip().lower().replace(" ", "_")
    if name not in units:
        raise CanrollError(f"{place}: {UnknownNameError('column', name, units)}")
    sizes = UNITS[units[name]]
    if unit not in sizes:
        known = ", ".join(f"{name} [{each}]" if each else name for each in sizes)
        given = f"unit {unit!r}" if unit else "no unit"
        raise CanrollError(f"{place}: column {name} has {given}: write {known}")
    return name, sizes[unit]


def _number(cell: str, size: float, place: str, mark: str) -> float:
    given = cell.strip()
    try:
        number = float(given.replace(",", ".") if mark == ";" else given)
    except ValueError:
        number = nan
    if not isfinite(number):
        raise CanrollError(f"{place}: {given!r} is not a number")
    return _in_si(number, size)


def _in_si(number: float, size: float) -> float:
    """A number of a unit in SI: quotients of whole numbers are exact where products are not."""
    return number / round(1.0 / size) if size in (1e-3, 0.01) else number * size


def _check_rows(columns: Columns) -> None:
    count = len(next(iter(columns.values.values()), ()))
    if not 2 <= count <= MOST_ROWS:
        raise CanrollError(f"{columns.place}: {count} rows, a table has 2 to {MOST_ROWS}")
