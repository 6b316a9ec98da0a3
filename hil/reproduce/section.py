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
    """

    key: str
    title: str
    columns: Mapping[str, str]
    rows: Sequence[Mapping[str, Value]]
    note: str = ""

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
        rows = [
            [_cell(row[key], f"sections.{place}.rows.{number}.{key}") for key in self.columns]
            for number, row in enumerate(self.rows)
        ]
        return Table(self.title, tuple(self.columns.values()), rows, self.note)

    def markdown(self) -> list[str]:
        """Return the section as lines of Markdown."""
        lines = [f"### {self.title}", ""]
        lines += [f"| {' | '.join(self.columns.values())} |"]
        lines += [f"|{' --- |' * len(self.columns)}"]
        lines += [f"| {' | '.join(text(row[key]) for key in self.columns)} |" for row in self.rows]
        return [*lines, "", *([self.note, ""] if self.note else [])]


def finite(value: float) -> float | None:
    """Return ``value``, or None where it is infinite or no number, which JSON has no word for."""
    return float(value) if isfinite(value) else None


def text(value: Value) -> str:
    """Return a value as a table shows it: four digits."""
    if value is None:
        return "none"
    return value if isinstance(value, str) else f"{value:.4g}".replace("-", "−")


def _cell(value: Value, key: str) -> str | Cell:
    if value is None or isinstance(value, str):
        return text(value)
    return Cell(text(value), value, key)
