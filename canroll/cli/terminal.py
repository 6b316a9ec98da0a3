"""Terminal output of any command: progress, verdict, warnings, tables, files."""

import json
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec

import rich.table
from rich.cells import cell_len
from rich.console import ConsoleRenderable
from rich.progress import BarColumn, Progress, TextColumn
from rich.text import Text

from canroll.report.console import Console
from canroll.report.page import NUMBER, Cell, PageTable

Arguments = ParamSpec("Arguments")


@contextmanager
def progress(*, quiet: bool) -> Iterator[Callable[[str, float], None]]:
    """Show a bar per stage on stderr while the body runs; not on a terminal, a line a minute."""
    console = Console(stderr=True)
    if quiet:
        yield lambda stage, share: None
        return
    if not console.is_terminal:
        yield by_the_minute(lambda stage, share: f"{stage}: {100 * share:.0f} %")
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:.0f} %"))
    with Progress(*columns, console=console, transient=True) as bars:
        tasks = {}

        def report(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=share)

        yield report


MINUTE_S = 60.0


def by_the_minute(describe: Callable[Arguments, str]) -> Callable[Arguments, None]:
    """Return a function that notes on stderr, at most once a minute, what it is called with."""
    start = last = time.monotonic()

    def report(*args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= MINUTE_S:
            last = now
            note(f"{describe(*args, **kwargs)} after {(now - start) / MINUTE_S:.0f} min")

    return report


def note(text: str) -> None:
    """Print a line on stderr."""
    print(text, file=sys.stderr)


def _widths(columns: Sequence[Sequence[str]], room: int) -> list[int]:
    """Return the columns' widths in ``room``; what is too wide breaks, between words if it can."""
    widths = [max(map(cell_len, column)) for column in columns]
    words = [max(map(cell_len, " ".join(column).split()), default=0) for column in columns]
    while sum(widths) > max(room, len(widths)):
        widest = max(range(len(widths)), key=lambda it: (widths[it] > words[it], widths[it]))
        widths[widest] -= 1
    return widths


def columns(
    console: Console, head: Sequence[str], rows: Iterable[Sequence[str | Cell]]
) -> rich.table.Table:
    """Return a table as wide as the console; numbers stand on the right."""
    texts = [[cell if isinstance(cell, str) else cell.text for cell in row] for row in rows]
    shown = [
        (name, *(text[number] for text in texts if number < len(text)))
        for number, name in enumerate(head)
    ]
    table = rich.table.Table(box=None, pad_edge=False, header_style="bold")
    widths = _widths(shown, console.width - 2 * (len(shown) - 1))
    for number, (column, width) in enumerate(zip(shown, widths, strict=True)):
        figures = number > 0 and any(map(NUMBER.match, column[1:]))
        table.add_column(
            column[0], justify="right" if figures else "left", width=width, overflow="fold"
        )
    for text in texts:
        table.add_row(*text)
    return table


Part = str | PageTable | ConsoleRenderable
"""What is printed: lines of text, a table of a page, or what rich shows, such as a verdict."""


def emit(
    args: Namespace,
    data: Any,  # noqa: ANN401
    parts: Iterable[Part],
    *,
    good: bool = True,
    style: str = "",
) -> int:
    """Print the answer of a command, and return its exit code.

    Args:
        args: of the command line.
        data: the answer; it is what ``--json`` prints.
        parts: the answer for people; made where it is printed.
        good: whether all that was judged is good.
        style: of the parts.
    """
    if args.json:
        print(json.dumps(data))
    else:
        show(parts, style)
    return 0 if good else 1


def show(parts: Iterable[Part], style: str = "") -> None:
    """Print parts, one below the other."""
    console = Console(highlight=False, markup=False, emoji=False, style=style)
    for part in parts:
        if isinstance(part, PageTable):
            console.print(columns(console, part.head, part.rows))
        else:
            console.print(part, soft_wrap=isinstance(part, str | Text))


def plain(table: PageTable) -> Iterator[Part]:
    """Yield a table of a terminal, or the lines of one in Markdown for a pipe or a file."""
    if sys.stdout.isatty():
        yield table
        return
    columns = zip(*table.rows, strict=True)
    numeric = [any(NUMBER.match(str(cell)) for cell in column) for column in columns]
    rule = ["---:" if each else "---" for each in numeric]
    for row in (table.head, rule, *table.rows):
        yield f"| {' | '.join(map(str, row))} |"


def verdict(text: str, *, good: bool | None) -> Text:
    """Return the answer in one line: good, bad, or neither."""
    return Text(text, style={True: "green", False: "red", None: "yellow"}[good])


def titled(table: PageTable) -> tuple[Part, ...]:
    """Return a table below its title, after an empty line."""
    return f"\n{table.title}", table


def warnings(texts: Iterable[str]) -> Iterator[Text]:
    """Yield warnings, one line each."""
    for text in texts:
        yield Text.assemble(("warning:", "yellow"), f" {text}")


def files(written: Mapping[str, str]) -> Iterator[str]:
    """Yield the written files, a line for each folder."""
    folders: dict[Path, list[str]] = {}
    for path in map(Path, written.values()):
        folders.setdefault(path.parent, []).append(path.name)
    for folder, names in folders.items():
        yield f"written to {folder}: {', '.join(names)}"
