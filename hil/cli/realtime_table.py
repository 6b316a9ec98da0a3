"""The timing of a real-time run on the terminal."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

from hil.realtime.timing import QUANTILES, ROWS, bus_lines


def show_timing(timing: Mapping[str, Any]) -> None:
    """Print quantiles, misses, losses and notes."""
    console = Console(highlight=False)
    table = Table("µs", *QUANTILES, box=None, pad_edge=False, header_style="bold")
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
