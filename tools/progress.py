"""A progress bar on a terminal for long work; nothing in a pipe."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn


@contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show on stderr how much of ``total`` is done; the body reports increments.

    Without a refreshing thread, which would interfere with forks.
    """
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    quiet = not console.is_terminal
    with Progress(*columns, console=console, auto_refresh=False, disable=quiet) as bars:
        task = bars.add_task(what, total=total)
        yield lambda more: bars.update(task, advance=more, refresh=True)
