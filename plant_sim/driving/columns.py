"""Columns of a user's file by name: a CSV with its separators, or the vectors of a .mat file."""

import csv
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from canroll.codegen.frame import units
from canroll.documents import binary_kind, read_mat
from canroll.errors import CanrollError, UnknownNameError, reason
from canroll.typing import Vector

COMMENTS = ("#", "%", "$", "!")
"""What begins a comment; of comments above numbers without a header, the last is it."""
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
_NUMBER = re.compile(r"[-+]?(?=.?\d)\d*([.,]?)\d*(?:[eE][-+]?\d+)?")
MOST_NUMBERS = 100_000_000
"""Numbers of an array in a .mat file."""
# the micro sign folds to the Greek letter
TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "\u03bcs": 1e-6, "ns": 1e-9}
_KINDS = ("angle", "rate", "length", "speed", "acceleration", "force", "moment")
_BRACKETS = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]")


@dataclass(frozen=True, slots=True, eq=False)
class LogTable:
    """Columns of a file by name; ``numbers`` of one, NaN where it has none, as of its place.

    ``where`` are the names, for errors.
    """

    path: Path
    where: str
    names: Sequence[str]
    numbers: Callable[[int], Vector]

    def place(self, name: str) -> int:
        """Return which column has a name, given with its unit or without.

        Raises:
            CanrollError: none or several.
        """
        plain = " ".join(name.strip(" #%").split())
        places = [i for i, known in enumerate(self.names) if known == plain]
        places = places or [i for i, known in enumerate(self.names) if parted(known)[0] == plain]
        if not places:
            raise UnknownNameError(f"column of {self.path}", name, self.names)
        if len(places) > 1:
            raise CanrollError(f"{self.path}: {len(places)} columns are called {name}: keep one")
        return places[0]


def read_table(path: Path) -> LogTable:
    """Return the columns of a log.

    Raises:
        CanrollError: it cannot be read.
    """
    try:
        kind = binary_kind(path)
        is_mat = path.suffix.lower() == ".mat" or kind.startswith("a MATLAB")
        arrays = read_mat(path, MOST_NUMBERS) if is_mat else {}
    except (OSError, ValueError) as error:
        raise CanrollError(f"cannot read {path}: {reason(error)}") from error
    if is_mat:
        vectors = {
            name: array.ravel().astype(float)
            for name, array in arrays.items()
            if array.dtype.kind in "fiub" and array.size == max(array.shape, default=0) > 1
        }
        others = [f"{name} {arrays[name].shape}" for name in arrays.keys() - vectors.keys()]
        if not vectors:
            raise CanrollError(f"{path}: no vector of numbers, but {', '.join(sorted(others))}")
        columns = list(vectors.values())
        return LogTable(path, str(path), list(vectors), columns.__getitem__)
    (line, header), *below = rows(path) or [(1, [])]
    return LogTable(path, f"{path}: line {line}", header, partial(_numbers, path, below, header))


def _numbers(
    path: Path, below: Sequence[tuple[int, list[str]]], header: Sequence[str], place: int
) -> Vector:
    values = np.full(len(below), np.nan)
    for i, (line, row) in enumerate(below):
        text = row[place] if place < len(row) else ""
        try:
            values[i] = float(text) if text else np.nan
        except ValueError as error:
            raise CanrollError(
                f"{path}: line {line}: {header[place]}: '{text}' is no number"
            ) from error
    return values


def parted(column: str) -> tuple[str, str]:
    """Return the name and the unit of a column: "vx (m/s)", "vx [m/s]", "vx_m_s", "vx_mps"."""
    if match := _BRACKETS.fullmatch(column):
        return match[1], match[2]
    words = column.split("_")
    for i in range(1, len(words)):
        for mark in "/", "":
            text = re.sub(r"ps(2?)$", r"/s\1", mark.join(words[i:]))
            unit = units.normal(text) or ""
            if text.casefold() in TIME_UNITS or units.UNITS[unit].quantity in _KINDS:
                return "_".join(words[:i]), text
    return column, ""


def rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return the header and the rows of a CSV that are not empty, each with its line.

    Cells have single blanks and none around them, numbers with decimal points.

    Raises:
        CanrollError: the file cannot be read, is none of text, has a row longer than its header, or
            does not say what separates its columns or decimals.
    """
    lines = _lines(path)
    header, below, *_ = *(line for line in lines if line.strip()), "", ""
    marks = [mark for mark in _SEPARATORS if mark in header]
    if len(marks) > 1:
        same = [mark for mark in marks if header.count(mark) == below.count(mark)]
        if len(same) != 1:
            words = " or ".join(_SEPARATORS[mark] for mark in marks)
            raise CanrollError(f"{path}: line {lines.index(header) + 1}: {words}: keep one of them")
        marks = same
    try:
        reader = csv.reader(lines, delimiter=marks[0] if marks else ",")
        read = ((reader.line_num, row) for row in reader if row)
        table = [(line, [" ".join(cell.split()) for cell in row]) for line, row in read]
    except csv.Error as error:
        raise CanrollError(f"cannot read {path}: {reason(error)}") from error
    names = table[0][1] if table else []
    seen: dict[str, str] = {}
    for line, row in table[1:]:
        # a decimal comma would move what follows it to other columns
        if any(row[len(names) :]):
            raise CanrollError(f"{path}: line {line}: {len(row)} values in {len(names)} columns")
        for place, cell in enumerate(row[: len(names)] if marks != [","] else ()):
            if (match := _NUMBER.fullmatch(cell)) and match[1]:
                row[place] = cell.replace(",", ".")
                seen.setdefault(match[1], f"line {line}: {names[place]}: '{cell}'")
        if len(seen) > 1:
            both = " and ".join(seen.values())
            raise CanrollError(f"{path}: {both}: decimal commas or points: keep one of them")
    return table


def _lines(path: Path) -> list[str]:
    """Return the lines of a text, those empty that are comments and not its header."""
    try:
        if kind := binary_kind(path):
            raise CanrollError(f"{path}: {kind}: export the signals as CSV, one column each")
        content = path.read_bytes()
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("cp1252")  # as Windows writes it in Europe
    except (OSError, UnicodeDecodeError) as error:
        raise CanrollError(f"cannot read {path}: {reason(error)}") from error
    lines = list(io.StringIO(text, newline=""))
    plain = [i for i, line in enumerate(lines) if line.strip() and not _comment(line)]
    first = plain[0] if plain else 0
    above = [i for i in range(first) if _comment(lines[i])]
    if above and any(map(_NUMBER.fullmatch, re.split(r'[,;\s"]+', lines[first]))):
        plain.append(above[-1])
        lines[above[-1]] = lines[above[-1]].lstrip("".join((*COMMENTS, " ")))
    kept = set(plain)
    return [line if i in kept else "\n" for i, line in enumerate(lines)]


def _comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)
