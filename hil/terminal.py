"""What a run looks like on the terminal: a table, the verdict, and quiet progress."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from hil.report.rows import Row, can_rows, metric_rows
from hil.result import Result


@contextmanager
def progress(*, quiet: bool) -> Iterator[Callable[[str, float], None]]:
    """Show a bar per stage on stderr while the body runs; nothing where that is no terminal."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda stage, share: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:.0f} %"))
    with Progress(*columns, console=console, transient=True) as bars:
        tasks = {}

        def report(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=share)

        yield report


def _table(head: tuple[str, ...], rows: list[Row]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column(head[0], no_wrap=True)
    for name in head[1:]:
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(row.name, *(number.text for number in row.numbers))
    return table


def show(result: Result) -> None:
    """Print title, verdict, warnings, figures and files of a run."""
    console = Console(highlight=False)
    settings = result.settings
    console.print(
        f"[bold]{settings.scenario.replace('_', ' ')}[/bold], {settings.vehicle.name} at "
        f"{settings.speed * 3.6:.0f} km/h, {settings.law} over {settings.bus}"
    )
    colour = {True: "green", False: "red", None: "none"}[result.helps]
    console.print(f"[{colour}]{result.verdict}[/{colour}]" if colour != "none" else result.verdict)
    for warning in result.warnings:
        console.print(f"[yellow]warning:[/yellow] {warning}", soft_wrap=True)
    console.print()
    head = ("", "passive", "controlled", "change", "no roll at all")
    console.print(_table(head, metric_rows(result)))
    console.print()
    console.print(_table(("", "least", "mean", "most"), can_rows(result)))
    trigger = result.trigger
    console.print(
        f"bus load {100 * result.can.load:.1f} %; {trigger.sent} commands in {trigger.samples} "
        f"ticks: transmission rate {100 * trigger.transmission_rate:.1f} %, "
        f"{100 * trigger.transmission_rate_triggered:.1f} % without heartbeats "
        f"(heartbeats alone: {100 * trigger.floor:.0f} %)",
        soft_wrap=True,
    )
    if result.files:
        console.print("\n" + "\n".join(f"{name:<12} {path}" for name, path in result.files.items()))
