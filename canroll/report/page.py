"""The report page: verdict on top, plots between, parameters and provenance at the end."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from canroll.report.document import PLOT_STYLES, PLOTS, document
from canroll.report.figure import OVERVIEW, Figure

GROUPS = {
    "motion": "Motion",
    "control": "Control",
    "bus": "Bus",
    "timing": "Timing",
    "trade": "Trade-offs",
}
PHONE = 30
"""Letters in the longest words of a table's head that fit a phone; with more its rows stack."""
WORDS = 5
"""A column with longer text than this that is no number wraps, and starts on the left."""
NUMBER = re.compile(r"[<>≤≥×±+−-]? ?\d")
"""A cell that is a number; a column with one is aligned on the right."""


@dataclass(frozen=True, slots=True)
class PageVerdict:
    """The verdict in a few words: ``good`` is True, False, or None if nothing was judged."""

    good: bool | None
    headline: str
    text: str


@dataclass(frozen=True, slots=True)
class Cell:
    """A number in a table, with its key in the JSON object."""

    text: str
    value: float | None = None
    key: str = ""


@dataclass(frozen=True, slots=True)
class PageTable:
    """A titled table; cells are text or numbers with their provenance.

    ``notes`` are numbered below it; ``chapter`` is a heading above it, listed in the contents;
    ``group``: the figures of that group follow it instead of standing at the end.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    note: str = ""
    notes: Sequence[str] = ()
    chapter: str = ""
    group: str = ""


@dataclass(frozen=True, slots=True)
class Page:
    """Contents of a report page.

    ``result`` is embedded whole and can be saved from it; ``groups`` are titles of further groups
    of figures; ``greyed``: its figures are meaningless, as the verdict on top explains;
    ``workbench``: everything recorded, as :func:`canroll.report.workbench.workbench` returns it;
    ``foot``: tables that stand at the end, below the figures of the group that names them.
    """

    title: str
    subtitle: str
    verdict: PageVerdict
    warnings: Sequence[str]
    tables: Sequence[PageTable]
    figures: Sequence[Figure]
    playback: Mapping[str, object] | None
    parameters: Sequence[tuple[str, str]]
    provenance: Sequence[tuple[str, str]]
    result: Mapping[str, object] = field(default_factory=dict)
    groups: Mapping[str, str] = field(default_factory=dict)
    greyed: bool = False
    workbench: Mapping[str, object] | None = None
    foot: Mapping[str, Sequence[PageTable]] = field(default_factory=dict)


def _words(table: PageTable) -> list[bool]:
    """Return for each column whether it holds words, which wrap, instead of numbers."""
    columns = zip(*table.rows, strict=True) if table.rows else ((),) * len(table.head)
    return [
        any(isinstance(c, str) and len(c) > WORDS and not NUMBER.match(c) for c in column)
        for column in columns
    ]


def _laid_out(tables: Sequence[PageTable]) -> list[tuple[PageTable, list[bool], bool]]:
    return [(table, _words(table), _is_wide(table)) for table in tables]


def _is_wide(table: PageTable) -> bool:
    """Return whether the head is too wide for a phone even if its names wrap."""
    return sum(max(map(len, name.split()), default=0) for name in table.head) > PHONE


def _anchor(chapter: str) -> str:
    return "".join(character if character.isalnum() else "-" for character in chapter.lower())


def _groups(page: Page) -> dict[str, str]:
    """Return the titles of the groups of figures that stand at the end."""
    present = {figure.group for figure in page.figures} - {table.group for table in page.tables}
    titles = {**GROUPS, **page.groups}
    return {name: title for name, title in titles.items() if name in present}


def render(page: Page) -> str:
    """Return the page as one self-contained HTML document."""
    data = {
        "figures": [figure.data() for figure in page.figures],
        "playback": page.playback,
        "workbench": page.workbench,
    }
    return document(
        "report.html",
        page.title,
        styles=PLOT_STYLES,
        scripts=(*PLOTS, "playback.js", "recorded.js", "frames.js", "workbench.js", "page.js"),
        data={"result": page.result, "data": data},
        page=page,
        mark={True: "good", False: "bad", None: "none"}[page.verdict.good],
        tables=_laid_out(page.tables),
        foot={group: _laid_out(tables) for group, tables in page.foot.items()},
        chapters=[table.chapter for table in page.tables if table.chapter],
        overview=OVERVIEW if any(figure.group == OVERVIEW for figure in page.figures) else "",
        among=any(table.group for table in page.tables),
        groups=_groups(page),
        anchor=_anchor,
    )
