"""The report page: verdict on top, plots between, parameters and provenance at the end."""

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files

from hil.report.figure import Figure

GROUPS = {
    "motion": "Motion",
    "control": "Control",
    "bus": "Bus",
    "timing": "Timing",
    "trade": "Trade-offs",
}

HINT = (
    '<p class="soft">Drag across a plot to zoom, double-click to reset; click a name in a '
    "legend to switch its curve off and on.</p>"
)
PHONE = 30
"""Letters in the longest words of a table's head that fit a phone; with more its rows stack."""
WORDS = 5
"""A column with longer text than this wraps, and starts on the left."""


@dataclass(frozen=True, slots=True)
class Verdict:
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
class Table:
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
    of figures; ``greyed``: its figures are meaningless, as the verdict on top explains.
    """

    title: str
    subtitle: str
    verdict: Verdict
    warnings: Sequence[str]
    tables: Sequence[Table]
    figures: Sequence[Figure]
    playback: Mapping[str, object] | None
    parameters: Sequence[tuple[str, str]]
    provenance: Sequence[tuple[str, str]]
    result: Mapping[str, object] = field(default_factory=dict)
    groups: Mapping[str, str] = field(default_factory=dict)
    greyed: bool = False


def _text(value: object) -> str:
    return html.escape(str(value))


def _embedded(value: object) -> str:
    """JSON that cannot terminate its script element."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _cell(label: str, kind: str, cell: str | Cell) -> str:
    """A cell; ``label`` replaces the head of its column where rows are stacked."""
    data = kind + (f' data-label="{_text(label)}"' if label else "")
    if isinstance(cell, str):
        return f"<td{data}>{_text(cell)}</td>"
    if cell.key:
        data += f' data-key="{_text(cell.key)}" data-value="{cell.value!r}"'
    return f"<td{data}>{_text(cell.text)}</td>"


def _table(table: Table) -> str:
    columns = zip(*table.rows, strict=True) if table.rows else ((),) * len(table.head)
    words = [any(isinstance(c, str) and len(c) > WORDS for c in column) for column in columns]
    kinds = [' class="words"' if wrapped else "" for wrapped in words]
    head = "".join(
        f'<th scope="col"{kind}>{_text(name)}</th>'
        for name, kind in zip(table.head, kinds, strict=True)
    )
    rows = "".join(f"<tr>{''.join(map(_cell, table.head, kinds, row))}</tr>" for row in table.rows)
    least = sum(max(map(len, name.split()), default=0) for name in table.head)
    kind = ' class="wide"' if least > PHONE else ""
    note = f'<p class="soft">{_text(table.note)}</p>' if table.note else ""
    if table.notes:
        note += f"<ol>{''.join(f'<li>{_text(text)}</li>' for text in table.notes)}</ol>"
    title, chapter = _text(table.title), table.chapter
    heading = f"<h2>{title}</h2>"
    if chapter:
        heading = f'<h2 id="{_anchor(chapter)}">{_text(chapter)}</h2><h3>{title}</h3>'
    figures = _grid(table.group) if table.group else ""
    return (
        f'{heading}<div class="scroll"><table{kind}><thead><tr>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>{note}{figures}"
    )


def _anchor(chapter: str) -> str:
    return "".join(character if character.isalnum() else "-" for character in chapter.lower())


def _grid(group: str) -> str:
    return f'<div class="grid" data-figures="{_text(group)}"></div>'


def _contents(tables: Sequence[Table]) -> str:
    """Links to the chapters, where there are several."""
    chapters = [table.chapter for table in tables if table.chapter]
    if len(chapters) < 2:
        return ""
    links = "".join(f'<li><a href="#{_anchor(name)}">{_text(name)}</a></li>' for name in chapters)
    return f"<nav><ul>{links}</ul></nav>"


def _pairs(title: str, pairs: Sequence[tuple[str, str]]) -> str:
    rows = "".join(f"<tr><td>{_text(k)}</td><td>{_text(v)}</td></tr>" for k, v in pairs)
    return (
        f'<h2>{_text(title)}</h2><div class="scroll"><table class="parameters"><tbody>{rows}'
        "</tbody></table></div>"
    )


def _groups(page: Page) -> str:
    present = {figure.group for figure in page.figures} - {table.group for table in page.tables}
    titles = {**GROUPS, **page.groups}
    return "".join(
        f"<h2>{_text(title)}</h2>{_grid(name)}" for name, title in titles.items() if name in present
    )


def document(
    title: str, body: Sequence[str], *, styles: Sequence[str], scripts: Sequence[str]
) -> str:
    """Return a self-contained HTML document.

    Args:
        title: of the document, plain text.
        body: HTML.
        styles: names of style sheets of this package.
        scripts: names of its scripts, which run after the body is loaded.
    """
    assets = files("hil.report") / "assets"
    return "\n".join(
        [
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{_text(title)}</title>",
            '<link rel="icon" href="data:,">',
            *(f"<style>{(assets / name).read_text(encoding='utf-8')}</style>" for name in styles),
            "</head><body>",
            *body,
            *(
                f"<script>{(assets / name).read_text(encoding='utf-8')}</script>"
                for name in scripts
            ),
            "</body></html>",
        ]
    )


def data_element(name: str, value: object) -> str:
    """Return the element that holds ``value`` as JSON for the scripts of a page."""
    return f'<script type="application/json" id="{name}">{_embedded(value)}</script>'


def render(page: Page) -> str:
    """Return the page as one self-contained HTML document."""
    data = {"figures": [figure.data() for figure in page.figures], "playback": page.playback}
    mark = {True: "good", False: "bad", None: "none"}[page.verdict.good]
    warnings = "".join(f"<li>{_text(warning)}</li>" for warning in page.warnings)
    tables = "".join(_table(table) for table in page.tables)
    among = any(table.group for table in page.tables)
    player = '<h2>Playback</h2><section class="playback" id="playback"></section>'
    body = [
        "<main class=greyed>" if page.greyed else "<main>",
        f"<h1>{_text(page.title)}</h1>",
        f'<p class="soft">{_text(page.subtitle)}</p>',
        f'<div class="verdict {mark}"><strong>{_text(page.verdict.headline)}</strong>'
        f"{_text(page.verdict.text)}</div>",
        f'<ul class="warnings">{warnings}</ul>' if warnings else "",
        _contents(page.tables),
        HINT if among else "",
        tables,
        player if page.playback else "",
        "" if among else HINT,
        _groups(page),
        _pairs("Parameters", page.parameters),
        _pairs("Provenance", page.provenance),
        '<p><a id="save-json" download="result.json">Save these numbers as JSON</a></p>',
        "</main>",
        data_element("result", page.result),
        data_element("data", data),
    ]
    scripts = ("base.js", "plot.js", "playback.js", "page.js")
    return document(page.title, body, styles=("page.css",), scripts=scripts)
