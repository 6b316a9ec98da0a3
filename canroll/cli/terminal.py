"""Terminal output of a run: table, verdict and progress."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import astuple
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

import rich.table
from rich.cells import cell_len
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from canroll.report.console import Console
from canroll.report.page import NUMBER, Cell, PageTable
from canroll.report.tables import (
    authentication_note,
    can_rows,
    metric_head,
    metric_rows,
    reaction_tables,
    replay_note,
)
from canroll.runs import standard
from canroll.runs.result import Result
from hil.timing import QUANTILES, ROWS, bus_lines
from plant_sim.driving import maneuvers

if TYPE_CHECKING:
    from canroll.campaigns.summary import Summary

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


@contextmanager
def draws(total: int, *, quiet: bool) -> "Iterator[Callable[[Summary, int], None]]":
    """Show draws, rate, time left and failures so far on stderr; not on a terminal, as above."""
    console = Console(stderr=True)
    if quiet:
        yield lambda summary, kept: None
        return
    if not console.is_terminal:
        yield by_the_minute(lambda summary, kept: f"draw {summary.draws} of {total}")
        return
    columns = (
        TextColumn("draw {task.completed:.0f} of {task.total:.0f}"),
        BarColumn(),
        TextColumn("{task.fields[rate]} {task.fields[fails]} fail"),
        TimeRemainingColumn(compact=True),
    )
    with Progress(*columns, console=console, transient=True) as bars:
        task = bars.add_task("", total=total, rate="", fails=0)
        start = time.monotonic()

        def report(summary: "Summary", kept: int) -> None:
            rate = (summary.draws - kept) / max(time.monotonic() - start, 1e-9)
            bars.update(
                task, completed=summary.draws, rate=f"{rate:.1f} draws/s", fails=summary.fails
            )

        yield report


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


def _table(
    console: Console, head: Sequence[str], rows: Iterable[Sequence[str | Cell]]
) -> rich.table.Table:
    texts = [[cell if isinstance(cell, str) else cell.text for cell in row] for row in rows]
    columns = [
        (name, *(text[number] for text in texts if number < len(text)))
        for number, name in enumerate(head)
    ]
    table = rich.table.Table(box=None, pad_edge=False, header_style="bold")
    widths = _widths(columns, console.width - 2 * (len(columns) - 1))
    for number, (column, width) in enumerate(zip(columns, widths, strict=True)):
        figures = number > 0 and any(map(NUMBER.match, column[1:]))
        table.add_column(
            column[0], justify="right" if figures else "left", width=width, overflow="fold"
        )
    for text in texts:
        table.add_row(*text)
    return table


def show_verdict(text: str, *, good: bool | None) -> None:
    """Print the answer in one line: good, bad, or neither."""
    style = {True: "green", False: "red", None: "yellow"}[good]
    Console(highlight=False).print(Text(text, style=style), soft_wrap=True)


def show_table(table: PageTable) -> None:
    """Print a table of a report page."""
    console = Console(highlight=False)
    console.print(_table(console, table.head, table.rows))


def show_titled(table: PageTable) -> None:
    """Print a table below its title, after an empty line."""
    print(f"\n{table.title}")
    show_table(table)


def show_warnings(warnings: Iterable[str]) -> None:
    """Print warnings, one line each."""
    console = Console(highlight=False)
    for warning in warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(warning)}", soft_wrap=True)


def show_files(files: Mapping[str, str]) -> None:
    """Print the written files, a line for each folder."""
    folders: dict[Path, list[str]] = {}
    for path in map(Path, files.values()):
        folders.setdefault(path.parent, []).append(path.name)
    for folder, names in folders.items():
        print(f"written to {folder}: {', '.join(names)}")


def circumstances(result: Result) -> str:
    """Return every option of the manoeuvre in effect, the conditions and the faults in one line."""
    settings = result.settings
    parts = [f"{key} {text}" for key, text in maneuvers.written(result.options).items()]
    parts += [f"{key} {value}" for key, value in settings.conditions]
    parts += [f"fault {text}" for text in settings.faults]
    return ", ".join(parts)


def show(result: Result) -> None:
    """Print title, verdict, warnings and metrics (dimmed if invalid) of a run."""
    console = Console(highlight=False, style="dim" if result.not_valid else "")
    settings = result.settings
    console.print(
        f"[bold]{settings.scenario.replace('_', ' ')}[/bold], {settings.vehicle_name} at "
        f"{settings.speed * 3.6:.0f} km/h, {settings.law_name} over {settings.bus_name}"
    )
    show_verdict(result.verdict, good=result.good)
    show_warnings(text for text in result.warnings if text not in result.verdict)
    if line := circumstances(result):
        console.print(line, soft_wrap=True, markup=False)
    console.print()
    head = metric_head(result, "passive", "controlled")
    console.print(_table(console, head, [(row.name, *row.numbers) for row in metric_rows(result)]))
    judged = () if result.not_valid else standard.lines(result.standard)
    notes = [text for text in (replay_note(result), *judged) if text]
    if notes:
        console.print("\n" + "\n".join(notes), soft_wrap=True, markup=False)
    for table in reaction_tables(result) if result.settings.faults else ():
        console.print()
        console.print(_table(console, table.head, table.rows))
    trigger = result.trigger
    age = result.can.age_ms
    console.print(
        f"bus load {100 * result.can.load:.1f} %, commands in "
        f"{100 * trigger.transmission_rate:.1f} % of {trigger.samples} ticks"
        + ("" if age is None else f", sample to force {age.mean:.2f} ms, at most {age.max:.2f}"),
        soft_wrap=True,
    )
    if (text := authentication_note(result)) is not None:
        console.print(text, soft_wrap=True)


def show_bus(result: Result) -> None:
    """Print response times by message, and what a run says about trigger and phase."""
    console = Console(highlight=False, style="dim" if result.not_valid else "")
    head = ("", "least", "mean", "most")
    console.print()
    console.print(_table(console, head, [(row.name, *row.numbers) for row in can_rows(result)]))
    trigger = result.trigger
    console.print(
        f"{trigger.sent} commands: {100 * trigger.transmission_rate_triggered:.1f} % of the ticks "
        f"without heartbeats (heartbeats alone: {100 * trigger.floor:.0f} %)"
    )
    if result.phase is not None:
        least, mean, most = (1e3 * value for value in astuple(result.phase))
        console.print(
            f"a tick starts {mean:.2f} ms after the newest Imu frame ({least:.2f} to {most:.2f} ms)"
        )


def show_timing(timing: Mapping[str, Any]) -> None:
    """Print quantiles, misses, losses and notes."""
    console = Console(highlight=False)
    table = rich.table.Table("µs", *QUANTILES, box=None, pad_edge=False, header_style="bold")
    for column in table.columns[1:]:
        column.justify = "right"
    for key, name in ROWS.items():
        figures = timing[key]
        if figures is not None:
            table.add_row(name, *(f"{figures[quantile]:.0f}" for quantile in QUANTILES))
    console.print()
    console.print(table)
    console.print(
        f"{timing['ticks']} ticks, {timing['deadline_misses']} missed, "
        f"{timing['frames_lost']} frames lost"
    )
    if timing["pace"] == "lockstep":
        console.print(f"in lock step, {timing['speed']:.1f} times as fast as real time")
    for line in bus_lines(timing):
        console.print(line, soft_wrap=True, markup=False)
    for note in timing["notes"]:
        console.print(f"[yellow]note:[/yellow] {note}", soft_wrap=True)
