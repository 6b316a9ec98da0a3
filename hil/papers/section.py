"""A table of a paper's chapter that holds no printed numbers: ours alone, or laws side by side."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from hil.report.page import Cell, Table

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
