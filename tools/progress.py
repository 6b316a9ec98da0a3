"""A bar on the terminal for work that takes long; nothing in a pipe."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn


@contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show on stderr how much of ``total`` is done while the body runs, which says how much more.

    Without a thread that refreshes: it would be in the way of forks.
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
