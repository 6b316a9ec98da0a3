"""The page of the recomputed tables."""

import platform
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from itertools import groupby

from hil.papers.paper_table import LEAST_SHARE, TOLERANCE, digits
from hil.papers.reproduce import Reproduction, summary, to_json
from hil.report.page import Cell, Page, Table, Verdict, render
from hil.report.tables import change

HEAD = ("", "printed", "ours", "off by", "verdict")
UNITS = {"rms": "RMS", "nlt": "NLT", "db": "(dB)", "percent": "(%)"}
"""Words of a quantity's key that are spelt otherwise in text."""


def legend() -> str:
    """Return the meaning of the verdicts."""
    return (
        f"Reproduced: within {100 * TOLERANCE:.0f} % of the printed number. Same ordering: a "
        "larger deviation, but on the same side of every other number of its table and quantity "
        f"(a number without others: same sign and at least {100 * LEAST_SHARE:.0f} % of it). Not "
        "reproducible: neither, with the reason found. Plants are calibrated on passive rows "
        "only; these rows are marked."
    )


def _tables(part: Reproduction, first: int) -> list[Table]:
    """Return a table for each of the paper's; reasons are numbered below it, each once."""
    counts = ", ".join(f"{count} {verdict}" for verdict, count in part.counts.items())
    found: list[Table] = []
    places = enumerate(part.rows, first)
    for name, rows in groupby(places, key=lambda numbered: numbered[1].table):
        notes: dict[str, int] = {}
        cells: list[list[str | Cell]] = []
        for place, row in rows:
            mark = f" ({notes.setdefault(row.reason, len(notes) + 1)})" if row.reason else ""
            cells.append(
                [
                    f"{row.row}, {_spelt(row.quantity)}",
                    Cell(f"{row.printed:g}", row.printed, f"rows.{place}.printed"),
                    Cell(f"{digits(row.ours, 3)}", row.ours, f"rows.{place}.ours"),
                    change(row.ours, row.printed, 9),
                    f"{row.verdict}{mark}",
                ]
            )
        chapter = "" if found else f"{part.paper.title}: {counts}"
        found.append(Table(name, HEAD, cells, notes=tuple(notes), chapter=chapter))
    return found


def _spelt(quantity: str) -> str:
    return " ".join(UNITS.get(word, word) for word in quantity.split("_"))


def reproduction_page(found: Sequence[Reproduction]) -> str:
    """Return the page as one HTML document."""
    tables: list[Table] = []
    first = place = 0
    for part in found:
        tables += _tables(part, first)
        first += len(part.rows)
        for section in part.sections:
            tables.append(section.table(place))
            place += 1
        tables[-1] = replace(tables[-1], group=part.paper.name)
    return render(
        Page(
            title="The papers' tables, recomputed",
            subtitle="through fixed-point firmware, simulated bus and vehicle",
            verdict=Verdict(None, summary(found), legend()),
            warnings=(),
            tables=tables,
            figures=[figure for part in found for figure in part.figures],
            playback=None,
            parameters=[(part.paper.title, part.paper.conditions) for part in found],
            provenance=[("canroll", version("canroll")), ("Python", platform.python_version())],
            result=to_json(found),
        )
    )
