"""The console of every table and line: it breaks and cuts them at a terminal alone."""

import os
from typing import Any

from rich.console import Console as RichConsole

WIDEST = 1_000_000
"""Columns of what is not a terminal: a pipe or a file has no edge at which a line must break."""


class Console(RichConsole):
    """A console that breaks lines at a terminal alone and leaves a closed pipe to the caller."""

    def __init__(self, **options: Any) -> None:  # noqa: ANN401
        super().__init__(**options)
        self.has_edge = self.is_terminal or "COLUMNS" in os.environ
        """Whether there is a width that lines must keep to."""
        if not self.has_edge:
            self.width = WIDEST

    def on_broken_pipe(self) -> None:
        """Do not suppress the error."""
        raise BrokenPipeError
