"""One printed number, ours, and the verdict on it."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from math import isfinite
from typing import Any

from hil.report.page import Cell, Table

REPRODUCED = "reproduced"
SAME_ORDERING = "same ordering"
NOT_REPRODUCIBLE = "not reproducible"
VERDICTS = (REPRODUCED, SAME_ORDERING, NOT_REPRODUCIBLE)

TOLERANCE = 0.15
"""Relative difference up to which a number counts as reproduced."""
TIE = 0.02
"""Printed values closer than this share have no order."""
LEAST_SHARE = 0.25
"""Share of a printed number that a lone one must reach to be of the same order."""


@dataclass(frozen=True, slots=True)
class Row:
    """One number of a table: where it is printed, what is printed, what we find.

    ``group``: numbers of one group are ordered among each other. ``finding``: what explains a
    difference; it is dropped where there is none to explain. ``calibrated``: the plant was fitted
    to this number, so that its agreement proves nothing.
    """

    paper: str
    table: str
    row: str
    quantity: str
    printed: float
    ours: float
    group: str = ""
    finding: str = ""
    calibrated: bool = False
    verdict: str = ""

    @property
    def difference_percent(self) -> float:
        """Ours against printed, percent."""
        return 100 * (self.ours / self.printed - 1)

    @property
    def reason(self) -> str:
        """Why the number is not met; empty where it is."""
        if self.verdict == REPRODUCED:
            return "calibrated on this number" if self.calibrated else ""
        return self.finding

    def to_json(self) -> dict[str, Any]:
        """Return the row as ``canroll reproduce --json`` prints it."""
        return {
            "paper": self.paper,
            "table": self.table,
            "row": self.row,
            "quantity": self.quantity,
            "printed": self.printed,
            "ours": self.ours,
            "difference_percent": self.difference_percent,
            "verdict": self.verdict,
            "reason": self.reason,
        }


@cache
def printed(paper: str) -> dict[str, Any]:
    """Return the printed tables of a paper."""
    text = (files("hil.papers") / "printed.toml").read_text(encoding="utf-8")
    tables: dict[str, Any] = tomllib.loads(text)[paper]
    return tables


def judged(rows: Sequence[Row]) -> list[Row]:
    """Return the rows with their verdicts.

    Reproduced: within :data:`TOLERANCE` of the printed number. Same ordering: further off, but on
    the same side of every other number of its group as printed; a number without a group needs
    the same sign and a quarter of the size. Not reproducible: neither.
    """
    return [replace(row, verdict=_verdict(row, rows)) for row in rows]


def _verdict(row: Row, rows: Sequence[Row]) -> str:
    if abs(row.ours - row.printed) <= TOLERANCE * abs(row.printed):
        return REPRODUCED
    others = [
        other
        for other in rows
        if other is not row and row.group and (other.paper, other.group) == (row.paper, row.group)
    ]
    if not others:
        share = row.ours / row.printed
        return SAME_ORDERING if share >= LEAST_SHARE else NOT_REPRODUCIBLE
    for other in others:
        apart = row.printed - other.printed
        if abs(apart) <= TIE * abs(row.printed):
            continue
        if apart * (row.ours - other.ours) <= 0:
            return NOT_REPRODUCIBLE
    return SAME_ORDERING


Value = str | float | None


@dataclass(frozen=True, slots=True)
class Section:
    """Rows with the same columns.

    Attributes:
        key: unique within its paper.
        title: above the table.
        columns: label by key of a row, in order; the labels carry the units.
        rows: what the JSON prints; None where a number does not exist.
        note: what the table says.
        upright: shown with a line a column and a column a row, for few rows of many columns.
    """

    key: str
    title: str
    columns: Mapping[str, str]
    rows: Sequence[Mapping[str, Value]]
    note: str = ""
    upright: bool = False

    def to_json(self, paper: str) -> dict[str, Any]:
        """Return the section as ``canroll reproduce --json`` prints it."""
        return {
            "paper": paper,
            "section": self.key,
            "title": self.title,
            "rows": [dict(row) for row in self.rows],
            "note": self.note,
        }

    def table(self, place: int) -> Table:
        """Return the table of the page; ``place`` is that of the section in the JSON."""
        lines: list[Sequence[str | Cell]] = [tuple(self.columns.values())]
        lines += [
            [_cell(row[key], f"sections.{place}.rows.{number}.{key}") for key in self.columns]
            for number, row in enumerate(self.rows)
        ]
        head, *rows = zip(*lines, strict=True) if self.upright else lines
        return Table(self.title, [_shown(name) for name in head], rows, self.note)

    def markdown(self) -> list[str]:
        """Return the section as lines of Markdown."""
        table = self.table(0)
        lines = [f"### {self.title}", "", f"| {' | '.join(table.head)} |"]
        lines += [f"|{' --- |' * len(table.head)}"]
        lines += [f"| {' | '.join(map(_shown, row))} |" for row in table.rows]
        return [*lines, "", *([self.note, ""] if self.note else [])]


def finite(value: float) -> float | None:
    """Return ``value``, or None where it is infinite or no number, which JSON has no word for."""
    return float(value) if isfinite(value) else None


def text(value: Value) -> str:
    """Return a value as a table shows it: four digits, and never less than the whole number."""
    if value is None:
        return "none"
    return value if isinstance(value, str) else digits(value, 4).replace("-", "−")


def digits(value: float, count: int) -> str:
    """Return a number with ``count`` digits, without an exponent where it is large."""
    return f"{value:.0f}" if abs(value) >= 10 ** (count - 1) else f"{value:.{count}g}"


def _cell(value: Value, key: str) -> str | Cell:
    if value is None or isinstance(value, str):
        return text(value)
    return Cell(text(value), value, key)


def _shown(cell: str | Cell) -> str:
    return cell if isinstance(cell, str) else cell.text
