"""The page of the recomputed tables."""

import platform
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from itertools import groupby

from canroll.extensions.papers.paper_table import VERDICTS, finite
from canroll.extensions.papers.reproduce import (
    Reproduction,
    legend,
    shown,
    spelt,
    summary,
    to_json,
    towards_ours,
)
from canroll.report.page import Cell, Page, PageTable, PageVerdict, render

HEAD = ("", "printed", "paper's conditions", "ours", "verdict")


def _overview(parts: Sequence[Reproduction]) -> PageTable:
    """Return the answer: a line a paper."""
    head = ("", *VERDICTS, "reproduced, ours", "same ordering, ours")
    rows: list[list[str | Cell]] = []
    for part in parts:
        ours = list(part.counts_ours.values())[:2]
        rows.append([part.paper.title, *map(str, (*part.counts.values(), *ours))])
    return PageTable("Summary", head, rows, notes=[a for part in parts for a in part.answers])


def _tables(part: Reproduction, first: int) -> list[PageTable]:
    """Return a table for each of the paper's; reasons are numbered below it, each once."""
    tables: list[PageTable] = []
    places = enumerate(part.rows, first)
    for name, rows in groupby(places, key=lambda numbered: numbered[1].table):
        notes: dict[str, int] = {}
        cells: list[list[str | Cell]] = []
        for place, row in rows:
            step = towards_ours(row)
            reason = "; ".join(filter(None, (row.reason, step and f"to ours: {step}")))
            mark = f" ({notes.setdefault(reason, len(notes) + 1)})" if reason else ""
            theirs = f"rows.{place}.conditions.paper.value"
            cells.append(
                [
                    f"{row.row}, {spelt(row.quantity)}",
                    Cell(f"{row.printed:g}", row.printed, f"rows.{place}.printed"),
                    _cell(row.recomputed, theirs),
                    _cell(row.ours, f"rows.{place}.conditions.ours.value"),
                    f"{row.verdict}{mark}",
                ]
            )
        tables.append(PageTable(name, HEAD, cells, notes=tuple(notes)))
    return tables


def _chapter(part: Reproduction) -> str:
    counts = ", ".join(f"{count} {verdict}" for verdict, count in part.counts.items())
    return f"{part.paper.title}: {counts}"


def _cell(value: float, key: str) -> str | Cell:
    return shown(value) if finite(value) is None else Cell(shown(value), value, key)


def reproduction_page(parts: Sequence[Reproduction]) -> str:
    """Return the page as one HTML document."""
    tables = [_overview(parts)]
    first = place = 0
    for part in parts:
        rows = _tables(part, first)
        first += len(part.rows)
        proofs = [section.table(place + n) for n, section in enumerate(part.recomputed.proofs)]
        place += len(proofs)
        chapter = [*proofs, *rows]
        tables += [replace(chapter[0], chapter=_chapter(part)), *chapter[1:]]
        for section in part.recomputed.sections:
            tables.append(section.table(place))
            place += 1
        tables[-1] = replace(tables[-1], group=part.paper.name)
    return render(
        Page(
            title="The papers' tables, recomputed",
            subtitle="under each paper's conditions, and through firmware, bus and vehicle",
            verdict=PageVerdict(None, summary(parts), legend()),
            warnings=(),
            tables=tables,
            figures=[figure for part in parts for figure in part.recomputed.figures],
            playback=None,
            parameters=[(part.paper.title, part.paper.conditions) for part in parts],
            provenance=[("canroll", version("canroll")), ("Python", platform.python_version())],
            result=to_json(parts),
        )
    )
