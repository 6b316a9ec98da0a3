"""Terminal output of a run: its figures, what happened on its bus, and its times."""

from collections.abc import Mapping
from dataclasses import astuple
from typing import Any

import rich.table

from canroll.cli.terminal import columns, show_verdict, show_warnings
from canroll.report.console import Console
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
from hil.timing_rows import QUANTILES, ROWS, bus_lines
from plant_sim.driving import maneuvers


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
    console.print(columns(console, head, metric_rows(result)))
    judged = () if result.not_valid else standard.lines(result.standard)
    notes = [text for text in (replay_note(result), *judged) if text]
    if notes:
        console.print("\n" + "\n".join(notes), soft_wrap=True, markup=False)
    for table in reaction_tables(result) if result.settings.faults else ():
        console.print()
        console.print(columns(console, table.head, table.rows))
    trigger = result.trigger
    age = result.can.age_ms
    console.print(
        f"bus load {100 * result.can.load:.1f} %; commands in "
        f"{100 * trigger.transmission_rate:.1f} % of {trigger.samples} ticks"
        + (f"; sample to force {age.mean:.2f} ms (max {age.max:.2f})" if age else ""),
        soft_wrap=True,
    )
    if (text := authentication_note(result)) is not None:
        console.print(text, soft_wrap=True)


def show_bus(result: Result) -> None:
    """Print response times by message, and what a run says about trigger and phase."""
    console = Console(highlight=False, style="dim" if result.not_valid else "")
    head = ("", "least", "mean", "most")
    console.print()
    console.print(columns(console, head, can_rows(result)))
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
    """Print quantiles, misses, losses, whether the run is valid, and notes."""
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
    word = "[green]PASS[/green]" if timing["valid"] else "[red]FAIL[/red]"
    console.print(
        f"{word}  {timing['ticks']} ticks, {timing['deadline_misses']} missed, "
        f"{timing['frames_lost']} frames lost"
    )
    if timing["pace"] == "lockstep":
        console.print(f"in lock step, {timing['speed']:.1f} times as fast as real time")
    for line in bus_lines(timing):
        console.print(line, soft_wrap=True, markup=False)
    for note in timing["notes"]:
        console.print(f"[yellow]note:[/yellow] {note}", soft_wrap=True)
