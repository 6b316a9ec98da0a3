"""Reader of tyre property files (.tir) of the Magic Formula, in the form of TNO and Delft Tyre.

Sections in brackets, ``KEY = value``, comments after ``$`` or ``!``, texts in quotes, lines of
any ending. Units are SI; a file in others is refused.
"""

from collections.abc import Iterator
from math import isfinite, nan
from pathlib import Path
from typing import NamedTuple

from canroll.documents import text
from canroll.errors import CanrollError, reason
from canroll.vehicles.tyres.magic_formula import KEYS, NEEDED, NEW, OLD, POSITIVE, Coefficients

UNITS = {
    "LENGTH": ("meter", "metre", "meters", "metres", "m"),
    "FORCE": ("newton", "newtons", "n"),
    "ANGLE": ("radian", "radians", "rad"),
    "MASS": ("kg", "kilogram", "kilograms"),
    "TIME": ("second", "seconds", "sec", "s"),
    "PRESSURE": ("pascal", "pascals", "pa"),
}
"""Names of the SI units in the section [UNITS]."""
SIDES = {"LEFT": 1.0, "RIGHT": -1.0}
OTHER_AXES = ("LGAX", "LGAY", "LGAZ")
"""Scaling factors of the camber in version 5.2, which the formula here does not have."""
TABLES = ("SHAPE",)
"""Sections of rows instead of keys."""


class TirEntry(NamedTuple):
    """One key of a file: section, value and line."""

    section: str
    value: str
    line: int


def read(path: Path) -> Coefficients:
    """Return the coefficients of a tyre property file.

    Raises:
        CanrollError: it cannot be read, is no tyre of these versions, or not in SI units and ISO
            axes; the message has file and line.
    """
    try:
        content = text(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"cannot read tyre file {path}: {reason(error)}") from error
    entries: dict[str, TirEntry] = {}
    for key, entry in _entries(content, path):
        if entry.section == "UNITS":
            _check_unit(key, entry, path)
        elif key in KEYS or key in OTHER_AXES:
            if key in entries:
                raise CanrollError(
                    f"{path}, line {entry.line}: {key} again, it stands in line "
                    f"{entries[key].line} already: keep one of them"
                )
            entries[key] = entry
    values = {key: _number(key, entry, path) for key, entry in entries.items()}
    for key in OTHER_AXES:
        if values.pop(key, 1.0) != 1.0:
            raise CanrollError(
                f"{path}, line {entries[key].line}: {key} scales the camber, which is not "
                "supported: set it to 1 and scale LKYC and LKZC"
            )
    _check(values, entries, path)
    return Coefficients(values)


def _entries(content: str, path: Path) -> Iterator[tuple[str, TirEntry]]:
    """Keys with a value, in capitals; a key without value is missing."""
    section = ""
    for number, raw in enumerate(content.splitlines(), 1):
        line = _without_comment(raw).strip()
        if line.startswith("["):
            section = line.strip("[] \t").upper()
            continue
        if not line or section in TABLES or line[0] in "({'\"":
            continue
        key, equals, value = line.partition("=")
        if not equals:
            raise CanrollError(
                f"{path}, line {number}: {line[:40]!r} is neither [SECTION] nor KEY = value: "
                "is it a tyre property file?"
            )
        value = value.strip().strip("'\"").strip()
        if value:
            yield key.strip().upper(), TirEntry(section, value, number)


def _without_comment(line: str) -> str:
    quote = ""
    for place, letter in enumerate(line):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        elif letter in "$!":
            return line[:place]
    return line


def _check_unit(key: str, entry: TirEntry, path: Path) -> None:
    if key in UNITS and entry.value.lower() not in UNITS[key]:
        raise CanrollError(
            f"{path}, line {entry.line}: {key} in {entry.value}: only SI units are read; convert "
            f"the file to {UNITS[key][0]}"
        )


def _number(key: str, entry: TirEntry, path: Path) -> float:
    if key == "TYRESIDE":
        side = SIDES.get(entry.value.upper())
        if side is None:
            raise CanrollError(
                f"{path}, line {entry.line}: TYRESIDE is {entry.value!r}: must be LEFT or RIGHT"
            )
        return side
    try:
        number = float(entry.value.upper().replace("D", "E"))
    except ValueError:
        number = nan
    if not isfinite(number):
        raise CanrollError(f"{path}, line {entry.line}: {key} = {entry.value!r} is not a number")
    return number


def _check(values: dict[str, float], entries: dict[str, TirEntry], path: Path) -> None:
    """Refuse what is no tyre of these versions, one line each."""
    for key in NEEDED:
        if key not in values:
            raise CanrollError(f"{path}: {key} is missing: it is needed")
    if values["FITTYP"] not in (*OLD, *NEW):
        raise CanrollError(
            f"{path}, line {entries['FITTYP'].line}: FITTYP = {values['FITTYP']:g}: only the "
            "Magic Formula 5.2 (6, 21 or 52), 6.1 (61) and 6.2 (62) are read"
        )
    tyre = Coefficients(values)
    for key in POSITIVE:
        if not tyre[key] > 0.0:
            raise CanrollError(
                f"{path}, line {entries[key].line}: {key} = {values[key]:g}: must be positive"
            )
    if tyre.cornering(tyre["FNOMIN"]) >= 0.0:
        raise CanrollError(
            f"{path}, line {entries['PKY1'].line}: PKY1 = {values['PKY1']:g}: must be negative in "
            "the axes of the file (ISO, TYDEX W); convert a file in SAE axes"
        )
