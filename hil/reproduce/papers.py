"""The four papers by name, and what recomputing one leaves behind."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from canroll.errors import UnknownNameError
from hil.report.figure import Figure
from hil.reproduce import redondo2021, viadero2022, vu2020, yim2020
from hil.reproduce.driven import Recomputed
from hil.reproduce.rows import VERDICTS, Report, Row, judged


@dataclass(frozen=True, slots=True)
class Paper:
    """One paper: its key, what it is called, how it is run, and what recomputes it."""

    name: str
    title: str
    conditions: str
    recompute: Callable[[Report], Recomputed]


PAPERS = {
    module.PAPER: Paper(
        module.PAPER,
        module.TITLE,
        ", ".join(f"{key} {value}" for key, value in module.COMMON.items()),
        module.recompute,
    )
    for module in (redondo2021, viadero2022, vu2020, yim2020)
}


@dataclass(frozen=True, slots=True)
class Reproduction:
    """All rows of one paper with their verdicts, and its plots."""

    paper: Paper
    rows: Sequence[Row]
    figures: Sequence[Figure]

    @property
    def counts(self) -> dict[str, int]:
        """How many rows have each verdict."""
        found = Counter(row.verdict for row in self.rows)
        return {verdict: found[verdict] for verdict in VERDICTS}


def reproduce(names: Sequence[str], report: Report) -> list[Reproduction]:
    """Recompute the tables of the papers named, all of them for none.

    Raises:
        UnknownNameError: there is no such paper.
    """
    for name in names:
        if name not in PAPERS:
            raise UnknownNameError("paper", name, PAPERS)
    found = []
    for name in names or PAPERS:
        paper = PAPERS[name]
        recomputed = paper.recompute(report)
        found.append(Reproduction(paper, judged(recomputed.rows), recomputed.figures))
    return found


def to_json(found: Sequence[Reproduction]) -> dict[str, Any]:
    """Return what ``canroll reproduce --json`` prints."""
    return {
        "rows": [row.to_json() for part in found for row in part.rows],
        "counts": {part.paper.name: part.counts for part in found},
    }


def to_markdown(found: Sequence[Reproduction]) -> str:
    """Return the tables as Markdown, one section a paper."""
    lines = [
        "# The papers' tables, recomputed",
        "",
        "Written by `canroll reproduce`: every printed number beside ours, through fixed-point "
        "firmware, simulated bus and vehicle.",
        "",
    ]
    for part in found:
        lines += [f"## {part.paper.title}", "", _sentence(part.counts), ""]
        lines += ["| table | row | quantity | printed | ours | difference | verdict | reason |"]
        lines += ["| --- | --- | --- | ---: | ---: | ---: | --- | --- |"]
        lines += [
            f"| {row.table} | {row.row} | {row.quantity} | {row.printed:g} | {row.ours:.3g} "
            f"| {row.difference_percent:+.0f} % | {row.verdict} | {row.reason} |"
            for row in part.rows
        ]
        lines.append("")
    return "\n".join(lines)


def _sentence(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {verdict}" for verdict, count in counts.items()) + "."


def summary(found: Sequence[Reproduction]) -> str:
    """Return the verdicts of all papers in one line."""
    total = sum((Counter(part.counts) for part in found), Counter())
    rows = sum(len(part.rows) for part in found)
    return f"{rows} printed numbers: {_sentence({v: total[v] for v in VERDICTS})}"
