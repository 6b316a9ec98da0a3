"""One printed number, under the paper's conditions and ours, and the verdict on both."""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from math import isfinite
from typing import Any

from canroll.report.page import Cell, PageTable

REPRODUCED = "reproduced"
SAME_ORDERING = "same ordering"
FITTED = "fitted"
NOT_REPRODUCIBLE = "not reproducible"
VERDICTS = (REPRODUCED, SAME_ORDERING, FITTED, NOT_REPRODUCIBLE)

TOLERANCE = 0.10
"""Relative difference up to which a number counts as reproduced."""
TIE = 0.02
"""Printed values closer than this share have no order."""
LEAST_SHARE = 0.25
"""Share of a printed number that a lone one must reach to be of the same order."""


@dataclass(frozen=True, slots=True)
class PaperStep:
    """One step from the paper's conditions to ours: what was switched, and the number after it."""

    switched: str
    value: float


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One number of a table under both conditions.

    Attributes:
        paper: key.
        table: where it is printed.
        row: of that table.
        quantity: of that row, with its unit implied by ``printed.toml``.
        printed: by the paper.
        recomputed: under the paper's conditions; no number where its loop is unstable.
        ours: on the best plant and over the bus.
        group: numbers of one group are ordered among each other.
        finding: computed reason of a difference; dropped where there is none to explain.
        fitted: the paper's unknown was fitted to this number, so its agreement proves nothing.
        reading: condition of this row alone, where the paper's text allows several.
        attribution: from ``recomputed`` to ``ours``, one thing switched at a time.
        verdict: on ``recomputed``.
        verdict_ours: on ``ours``.
    """

    paper: str
    table: str
    row: str
    quantity: str
    printed: float
    recomputed: float
    ours: float
    group: str = ""
    finding: str = ""
    fitted: bool = False
    reading: str = ""
    attribution: Sequence[PaperStep] = ()
    verdict: str = ""
    verdict_ours: str = ""

    @property
    def reason(self) -> str:
        """Why the number is not met; empty where it is."""
        return "" if self.verdict in (REPRODUCED, FITTED) else self.finding

    @property
    def largest(self) -> PaperStep | None:
        """The step that changed most, with its change as value."""
        changes = self._changes()
        return max(changes, key=lambda step: abs(step.value), default=None)

    def _changes(self) -> list[PaperStep]:
        before = (self.recomputed, *(step.value for step in self.attribution))
        return [
            PaperStep(step.switched, step.value - value)
            for step, value in zip(self.attribution, before, strict=False)
            if isfinite(step.value - value)
        ]

    def to_json(self) -> dict[str, Any]:
        """Return the row as ``canroll reproduce --json`` prints it."""
        return {
            "paper": self.paper,
            "table": self.table,
            "row": self.row,
            "quantity": self.quantity,
            "printed": self.printed,
            "conditions": {
                "paper": _column(self.recomputed, self.printed, self.verdict)
                | {"reading": self.reading},
                "ours": _column(self.ours, self.printed, self.verdict_ours),
            },
            "fitted": self.fitted,
            "attribution": [
                {"switched": step.switched, "value": finite(step.value)}
                for step in self.attribution
            ],
            "verdict": self.verdict,
            "reason": self.reason,
        }


def _column(value: float, as_printed: float, verdict: str) -> dict[str, Any]:
    return {
        "value": finite(value),
        "difference_percent": finite(100 * (value / as_printed - 1)),
        "verdict": verdict,
    }


@cache
def printed(paper: str) -> dict[str, Any]:
    """Return the printed tables of a paper."""
    text = (files("canroll.extensions.papers") / "printed.toml").read_text(encoding="utf-8")
    tables: dict[str, Any] = tomllib.loads(text)[paper]
    return tables


def judged(rows: Sequence[PaperRow]) -> list[PaperRow]:
    """Return the rows with their verdicts under both conditions.

    Fitted: the number that the paper's unknown was fitted to. Reproduced: within :data:`TOLERANCE`
    of the printed number. Same ordering: further off, but on the same side of every other number
    of its group as printed; a number without a group needs the same sign and a quarter of the
    size. Not reproducible: neither. A loop that is unstable has no number, and orders nothing.
    """
    under_theirs = [row.recomputed for row in rows]
    under_ours = [row.ours for row in rows]
    return [
        replace(
            row,
            verdict=FITTED if row.fitted else _verdict(place, rows, under_theirs),
            verdict_ours=_verdict(place, rows, under_ours),
        )
        for place, row in enumerate(rows)
    ]


def _verdict(place: int, rows: Sequence[PaperRow], values: Sequence[float]) -> str:
    row, value = rows[place], values[place]
    if not isfinite(value):
        return NOT_REPRODUCIBLE
    if abs(value - row.printed) <= TOLERANCE * abs(row.printed):
        return REPRODUCED
    others = [
        (other, other_value)
        for other, other_value in zip(rows, values, strict=True)
        if other is not row and row.group and (other.paper, other.group) == (row.paper, row.group)
    ]
    if not others:
        share = value / row.printed
        return SAME_ORDERING if share >= LEAST_SHARE else NOT_REPRODUCIBLE
    for other, other_value in others:
        apart = row.printed - other.printed
        if abs(apart) <= TIE * abs(row.printed) or not isfinite(other_value):
            continue
        if apart * (value - other_value) <= 0:
            return NOT_REPRODUCIBLE
    return SAME_ORDERING


Value = str | float | None


@dataclass(frozen=True, slots=True)
class PaperSection:
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

    def table(self, place: int) -> PageTable:
        """Return the table of the page; ``place`` is that of the section in the JSON."""
        lines: list[Sequence[str | Cell]] = [tuple(self.columns.values())]
        lines += [
            [_cell(row[key], f"sections.{place}.rows.{number}.{key}") for key in self.columns]
            for number, row in enumerate(self.rows)
        ]
        head, *rows = zip(*lines, strict=True) if self.upright else lines
        return PageTable(self.title, [_shown(name) for name in head], rows, self.note)

    def markdown(self) -> list[str]:
        """Return the section without its note as lines of Markdown."""
        table = self.table(0)
        return [f"### {self.title}", "", *markdown_table(table.head, table.rows)]


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str | int | Cell]]) -> list[str]:
    """Return a table as lines of Markdown, with an empty one behind it."""
    lines = [head, ["---"] * len(head), *rows]
    return [*(f"| {' | '.join(map(_in_markdown, line))} |" for line in lines), ""]


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


def _shown(cell: str | int | Cell) -> str:
    return cell.text if isinstance(cell, Cell) else str(cell)


def _in_markdown(cell: str | int | Cell) -> str:
    return _shown(cell).replace("|", "\\|")
