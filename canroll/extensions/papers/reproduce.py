"""The four papers by name, and the results of recomputing one."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from canroll.cases.execution import IN_TURN, Cases
from canroll.errors import UnknownNameError
from canroll.extensions.papers import redondo2021, viadero2022, vu2020, yim2020
from canroll.extensions.papers.paper_runs import Headline, Recomputed
from canroll.extensions.papers.paper_table import (
    FITTED,
    LEAST_SHARE,
    REPRODUCED,
    SAME_ORDERING,
    TOLERANCE,
    VERDICTS,
    PaperRow,
    PaperSection,
    digits,
    judged,
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
        tally = Counter(row.verdict for row in self.rows)
        return {verdict: tally[verdict] for verdict in VERDICTS}

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


def to_markdown(parts: Sequence[Reproduction]) -> str:
    """Return verdicts, errata and unknowns as Markdown, one section a paper."""
    overview = ("paper", "numbers", *VERDICTS, "reproduced or same ordering on our plant and bus")
    lines = [
        "# The papers' tables, recomputed",
        "",
        f"**{summary(parts)}** Written by `canroll reproduce`, whose reproduction.html has the "
        "steps between the two columns, the gains and the plots too.",
        "",
        f"| {' | '.join(overview)} |",
        f"| --- |{' ---: |' * (len(overview) - 1)}",
    ]
    for part in parts:
        numbers = (len(part.rows), *part.counts.values(), _met(part.counts_ours))
        lines.append(f"| {part.paper.title} | {' | '.join(map(str, numbers))} |")
    lines += ["", legend(), ""]
    for part in parts:
        lines += [f"## {part.paper.title}", "", f"{_sentence(part.counts)}", ""]
        lines += [*(f"- {answer}" for answer in part.answers), ""]
        for section in part.recomputed.proofs:
            if section.key in ("errata", "unknowns"):
                lines += section.markdown()
        lines += ["### Every number", ""]
        lines += ["| row | quantity | printed | paper's conditions | verdict | why | ours |"]
        lines += ["| --- | --- | ---: | ---: | --- | --- | ---: |"]
        lines += [
            f"| {row.table}: {row.row} | {spelt(row.quantity)} | {row.printed:g} "
            f"| {shown(row.recomputed)} | {row.verdict} | {row.reason} | {shown(row.ours)} |"
            for row in part.rows
        ]
        lines.append("")
    return "\n".join(lines)


def shown(value: float) -> str:
    """Return a number of a row; of a loop that has none, why."""
    return digits(value, 3) if isfinite(value) else "unstable"


def towards_ours(row: PaperRow) -> str:
    """Return the step that changes most from the paper's conditions to ours, where it matters."""
    step = row.largest
    if step is None or abs(step.value) <= TOLERANCE * abs(row.printed):
        return ""
    return f"{step.switched} {step.value:+.2g}".replace(" -", " −")


def _met(counts: Mapping[str, int]) -> int:
    return counts[REPRODUCED] + counts[SAME_ORDERING]


def _sentence(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {verdict}" for verdict, count in counts.items()) + "."


def summary(parts: Sequence[Reproduction]) -> str:
    """Return the verdicts of all papers in one line."""
    total = sum((Counter(part.counts) for part in parts), Counter())
    rows = sum(len(part.rows) for part in parts)
    return f"{rows} printed numbers: {_sentence({v: total[v] for v in VERDICTS})}"
