"""The four papers by name, and the results of recomputing one."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import isfinite, nan
from typing import Any

from canroll.cases.execution import IN_TURN, Cases
from canroll.errors import UnknownNameError
from canroll.extensions.papers import redondo2021, viadero2022, vu2020, yim2020
from canroll.extensions.papers.paper_runs import Headline, Recomputed
from canroll.extensions.papers.paper_table import (
    FITTED,
    LEAST_SHARE,
    NOT_REPRODUCIBLE,
    SAME_ORDERING,
    TOLERANCE,
    VERDICTS,
    PaperRow,
    PaperSection,
    digits,
    judged,
    markdown_table,
)


@dataclass(frozen=True, slots=True)
class Paper:
    """One paper: its key, what it is called, how it is run, and what recomputes it."""

    name: str
    title: str
    conditions: str
    recompute: Callable[[], Recomputed]


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
    """A recomputed paper, and its rows with their verdicts."""

    paper: Paper
    recomputed: Recomputed
    rows: Sequence[PaperRow]

    @property
    def counts(self) -> dict[str, int]:
        """How many rows have each verdict under the paper's conditions."""
        return _tally(self.rows)

    @property
    def counts_ours(self) -> dict[str, int]:
        """How many rows have each verdict on our plant and bus."""
        tally = Counter(row.verdict_ours for row in self.rows)
        return {verdict: tally[verdict] for verdict in VERDICTS if verdict != FITTED}

    @property
    def every_section(self) -> Sequence[PaperSection]:
        """Proofs and further sections, in the order of the JSON."""
        return (*self.recomputed.proofs, *self.recomputed.sections)

    @property
    def answers(self) -> list[str]:
        """What the paper's systems achieve: in print, under its conditions, and under ours."""
        return [self._answer(headline) for headline in self.recomputed.headlines]

    def _answer(self, headline: Headline) -> str:
        by_row = {row.row: row for row in self.rows if _is(row, headline)}
        passive, active = by_row[headline.passive], by_row[headline.active]
        printed, theirs, ours = (
            100 * (before / after - 1)
            for before, after in (
                (active.printed, passive.printed),
                (active.recomputed, passive.recomputed),
                (active.ours, passive.ours),
            )
        )
        theirs_text = f"{theirs:+.0f} %" if isfinite(theirs) else "unstable"
        return (
            f"{active.table}, {active.row}, {spelt(active.quantity)}: printed {printed:+.0f} %, "
            f"paper's conditions {theirs_text}, ours {ours:+.0f} %."
        ).replace("-", "−")


def _is(row: PaperRow, headline: Headline) -> bool:
    return (row.table, row.quantity) == (headline.table, headline.quantity)


UNITS = {"rms": "RMS", "nlt": "NLT", "db": "(dB)", "percent": "(%)"}
"""Words of a quantity's key that are spelt otherwise in text."""


def spelt(quantity: str) -> str:
    """Return the key of a quantity as text."""
    return " ".join(UNITS.get(word, word) for word in quantity.split("_"))


def reproduce(names: Sequence[str], cases: Cases = IN_TURN) -> list[Reproduction]:
    """Recompute the tables of the papers named, all of them for none.

    Args:
        names: keys of :data:`PAPERS`.
        cases: what recomputes the papers, one a case.

    Raises:
        UnknownNameError: there is no such paper.
    """
    for name in names:
        if name not in PAPERS:
            raise UnknownNameError("paper", name, PAPERS)
    return list(cases.rows("papers", _reproduced, [(name,) for name in names or PAPERS]))


def _reproduced(name: str) -> Reproduction:
    paper = PAPERS[name]
    recomputed = paper.recompute()
    return Reproduction(paper, recomputed, judged(recomputed.rows))


def to_json(parts: Sequence[Reproduction]) -> dict[str, Any]:
    """Return what ``canroll reproduce --json`` prints."""
    return {
        "rows": [row.to_json() for part in parts for row in part.rows],
        "counts": {part.paper.name: part.counts for part in parts},
        "counts_ours": {part.paper.name: part.counts_ours for part in parts},
        "answers": {part.paper.name: part.answers for part in parts},
        "sections": [
            section.to_json(part.paper.name) for part in parts for section in part.every_section
        ],
    }


def legend() -> str:
    """Return the meaning of columns and verdicts."""
    return (
        "Paper's conditions: its gains, delays, observer and formulas on its own model, an ideal "
        "network, and one fitted unknown. Ours: fixed-point firmware, "
        "simulated bus, sensors and car. Verdicts are on the paper's conditions. Reproduced: "
        f"within {100 * TOLERANCE:.0f} %. Same ordering: further off, but on the same side of "
        "every other number of its table and quantity (a number without others: same sign and at "
        f"least {100 * LEAST_SHARE:.0f} %). Fitted: the unknown, or our course, "
        "was tuned to this number, which is never counted. E1, E2, …: the checks of the paper's "
        "chapter."
    )


COUNTS = ("paper, table", "numbers", *VERDICTS)
DIFFERENCES = ("why", "quantities", SAME_ORDERING, NOT_REPRODUCIBLE, "over printed", "tables")
DIFFER = "Numbers that differ, by reason, with least and greatest ratio to the printed ones:"


def to_markdown(parts: Sequence[Reproduction]) -> str:
    """Return counts by paper and table, what differs, errata and unknowns as Markdown."""
    counts: list[Sequence[str | int]] = []
    for part in parts:
        counts.append((f"**{part.paper.title}**", len(part.rows), *part.counts.values()))
        for name, group in groupby(part.rows, lambda row: row.table):
            rows = list(group)
            counts.append((name, len(rows), *_tally(rows).values()))
    lines = [
        "# The papers' tables, recomputed",
        "",
        f"**{summary(parts)}** Written by `canroll reproduce`, whose reproduction.html and .json "
        "have every number, the steps between both conditions, gains and plots.",
        "",
        legend(),
        "",
        "Counts by paper and table:",
        "",
        *markdown_table(COUNTS, counts),
    ]
    for part in parts:
        lines += [f"## {part.paper.title}", "", DIFFER, ""]
        lines += markdown_table(DIFFERENCES, _differences(part.rows))
        for section in part.recomputed.proofs:
            if section.key in ("errata", "unknowns"):
                lines += section.markdown()
    return "\n".join(lines)


def _differences(rows: Sequence[PaperRow]) -> Iterator[Sequence[str | int]]:
    """Yield a line a reason: how many numbers differ, and by which ratios."""
    groups: dict[str, list[PaperRow]] = {}
    for row in rows:
        if row.reason:
            groups.setdefault(row.reason.partition(":")[0], []).append(row)
    for head, group in groups.items():
        why = group[0].reason if len({row.reason for row in group}) == 1 else head
        quantities = ", ".join(dict.fromkeys(spelt(row.quantity) for row in group))
        tally = _tally(group)
        ratios = _span([row.recomputed / row.printed for row in group])
        tables = "; ".join(dict.fromkeys(row.table for row in group))
        yield why, quantities, tally[SAME_ORDERING], tally[NOT_REPRODUCIBLE], ratios, tables


def _span(ratios: Sequence[float]) -> str:
    """Return least and greatest of ratios, and whether some are of unstable loops."""
    least, *more = sorted(filter(isfinite, ratios)) or [nan]
    ends = " to ".join(dict.fromkeys(f"{end:.2g}" for end in (least, *more[-1:])))
    return ends if isfinite(sum(ratios)) else f"{ends}, unstable".removeprefix("nan, ")


def _tally(rows: Sequence[PaperRow]) -> dict[str, int]:
    counts = Counter(row.verdict for row in rows)
    return {verdict: counts[verdict] for verdict in VERDICTS}


def shown(value: float) -> str:
    """Return a number of a row; of a loop that has none, why."""
    return digits(value, 3) if isfinite(value) else "unstable"


def towards_ours(row: PaperRow) -> str:
    """Return the step that changes most from the paper's conditions to ours, where it matters."""
    step = row.largest
    if step is None or abs(step.value) <= TOLERANCE * abs(row.printed):
        return ""
    return f"{step.switched} {step.value:+.2g}".replace(" -", " −")


def summary(parts: Sequence[Reproduction]) -> str:
    """Return the verdicts of all papers in one line."""
    rows = [row for part in parts for row in part.rows]
    counts = ", ".join(f"{count} {verdict}" for verdict, count in _tally(rows).items())
    return f"{len(rows)} printed numbers: {counts}."
