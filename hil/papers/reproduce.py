"""The four papers by name, and the results of recomputing one."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from canroll.errors import CanrollError, UnknownNameError
from canroll.typing import Progress
from hil.papers import redondo2021, viadero2022, vu2020, yim2020
from hil.papers.effort_section import RUNS, beside
from hil.papers.paper_runs import Recomputed
from hil.papers.paper_table import VERDICTS, Row, Section, digits, judged
from hil.report.figure import Figure


@dataclass(frozen=True, slots=True)
class Paper:
    """One paper: its key, what it is called, how it is run, and what recomputes it."""

    name: str
    title: str
    conditions: str
    recompute: Callable[[Progress], Recomputed]


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
    """All rows of one paper with their verdicts, what else was found, and its plots."""

    paper: Paper
    rows: Sequence[Row]
    figures: Sequence[Figure]
    sections: Sequence[Section] = ()

    @property
    def counts(self) -> dict[str, int]:
        """How many rows have each verdict."""
        found = Counter(row.verdict for row in self.rows)
        return {verdict: found[verdict] for verdict in VERDICTS}


def reproduce(names: Sequence[str], report: Progress, *, runs: int = RUNS) -> list[Reproduction]:
    """Recompute the tables of the papers named, all of them for none.

    Args:
        names: keys of :data:`PAPERS`.
        report: called with a title and the share done.
        runs: paired runs of each law beside ours; 0 leaves that comparison out.

    Raises:
        UnknownNameError: there is no such paper.
        CanrollError: one run, of which there is no interval.
    """
    if runs < 0 or runs == 1:
        raise CanrollError(
            f"--runs must be 0 (no runs) or at least 2 for paired intervals, got {runs}"
        )
    for name in names:
        if name not in PAPERS:
            raise UnknownNameError("paper", name, PAPERS)
    found = []
    for name in names or PAPERS:
        paper = PAPERS[name]
        recomputed = paper.recompute(report)
        sections, figures = [*recomputed.sections], [*recomputed.figures]
        if runs:
            tables, trade_off = beside(name, report, runs=runs)
            sections, figures = [*sections, *tables], [*figures, trade_off]
        found.append(Reproduction(paper, judged(recomputed.rows), figures, sections))
    return found


def to_json(found: Sequence[Reproduction]) -> dict[str, Any]:
    """Return what ``canroll reproduce --json`` prints."""
    return {
        "rows": [row.to_json() for part in found for row in part.rows],
        "counts": {part.paper.name: part.counts for part in found},
        "sections": [
            section.to_json(part.paper.name) for part in found for section in part.sections
        ],
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
            f"| {row.table} | {row.row} | {row.quantity} | {row.printed:g} | {digits(row.ours, 3)} "
            f"| {row.difference_percent:+.0f} % | {row.verdict} | {row.reason} |"
            for row in part.rows
        ]
        lines.append("")
        for section in part.sections:
            lines += section.markdown()
    return "\n".join(lines)


def _sentence(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {verdict}" for verdict, count in counts.items()) + "."


def summary(found: Sequence[Reproduction]) -> str:
    """Return the verdicts of all papers in one line."""
    total = sum((Counter(part.counts) for part in found), Counter())
    rows = sum(len(part.rows) for part in found)
    return f"{rows} printed numbers: {_sentence({v: total[v] for v in VERDICTS})}"
