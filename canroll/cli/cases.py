"""How the commands that drive many cases drive them: options, progress, interruption."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from canroll.cases.execution import Cases, Execution
from canroll.cli import terminal
from canroll.errors import CanrollError


def check(args: argparse.Namespace, out: Path | None) -> None:
    """Refuse options of :func:`canroll.cli.options.execution` that contradict each other.

    ``out``: the output folder, or None.
    """
    if args.resume and out is None:
        raise CanrollError("--resume needs the folder to continue in: add --out")


@contextmanager
def driven(args: argparse.Namespace, out: Path | None) -> Iterator[Cases]:
    """Yield what drives the cases of a command, and show its progress.

    ``out``: the output folder, where rows are kept until all cases are driven; None: nowhere.
    """
    check(args, out)
    folder = None if out is None or args.only is not None else out / f"{args.arguments[0]}-cases"
    execution = Execution(args.jobs, args.scheduler, folder, args.resume, args.only)
    try:
        with terminal.progress(quiet=args.json) as progress, execution.cases(progress) as cases:
            yield cases
    except KeyboardInterrupt:
        if execution.kept:
            terminal.note(f"{execution.kept} cases are in {folder}: continue with --resume")
        raise
