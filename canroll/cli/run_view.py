"""Terminal output of a run: its figures, what happened on its bus, and its times."""

from collections.abc import Iterator, Mapping
from dataclasses import astuple
from typing import Any

from rich.text import Text

from canroll.cli import terminal
from canroll.cli.terminal import Part
from canroll.plant_sim.driving import maneuvers
from canroll.report.page import PageTable
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


def circumstances(result: Result) -> str:
    """Return every option of the manoeuvre in effect, the conditions and the faults in one line."""
    settings = result.settings
    parts = [f"{key} {text}" for key, text in maneuvers.written(result.options).items()]
    parts += [f"{key} {value}" for key, value in settings.conditions]
    parts += [f"fault {text}" for text in settings.faults]
    return ", ".join(parts)


def style(result: Result) -> str:
    """Return the style of a run's parts: dim if it is not valid."""
    return "dim" if result.not_valid else ""


def parts(result: Result, *, verbose: bool = False) -> Iterator[Part]:
    """Yield title, verdict, warnings and metrics of a run.

    With ``verbose`` response times by message, and what is said about trigger and phase too.
    """
    settings = result.settings
    yield Text.assemble(
        (settings.scenario.replace("_", " "), "bold"),
        f", {settings.vehicle_name} at {settings.speed * 3.6:.0f} km/h, {settings.law_name} over "
        f"{settings.bus_name}",
    )
    yield terminal.verdict(result.verdict, good=result.good)
    yield from terminal.warnings(text for text in result.warnings if text not in result.verdict)
    yield from filter(None, [circumstances(result)])
    yield ""
    yield PageTable("", metric_head(result, "passive", "controlled"), metric_rows(result))
    judged = () if result.not_valid else standard.lines(result.standard)
    notes = [text for text in (replay_note(result), *judged) if text]
    if notes:
        yield "\n" + "\n".join(notes)
    for table in reaction_tables(result) if settings.faults else ():
        yield from ("", table)
    trigger, age = result.trigger, result.can.age_ms
    yield (
        f"bus load {100 * result.can.load:.1f} %; commands in "
        f"{100 * trigger.transmission_rate:.1f} % of {trigger.samples} ticks"
        + (f"; sample to force {age.mean:.2f} ms (max {age.max:.2f})" if age else "")
    )
    yield from filter(None, [authentication_note(result)])
    if verbose:
        yield from of_the_bus(result)
    yield from terminal.files(result.files)


def of_the_bus(result: Result) -> Iterator[Part]:
    """Yield response times by message, and what a run says about trigger and phase."""
    yield from ("", PageTable("", ("", "least", "mean", "most"), can_rows(result)))
    trigger = result.trigger
    yield (
        f"{trigger.sent} commands: {100 * trigger.transmission_rate_triggered:.1f} % of the ticks "
        f"without heartbeats (heartbeats alone: {100 * trigger.floor:.0f} %)"
    )
    if result.phase is not None:
        least, mean, most = (1e3 * value for value in astuple(result.phase))
        after = f"{mean:.2f} ms after the newest Imu frame ({least:.2f} to {most:.2f} ms)"
        yield f"a tick starts {after}"


def timing(figures: Mapping[str, Any]) -> Iterator[Part]:
    """Yield quantiles, misses, losses, whether the run is valid, and notes."""
    from canroll.hil.timing_rows import QUANTILES, ROWS, bus_lines  # noqa: PLC0415 - of real time alone

    rows = [
        (name, *(f"{of[quantile]:.0f}" for quantile in QUANTILES))
        for name, of in ((name, figures[key]) for key, name in ROWS.items())
        if of is not None
    ]
    yield from ("", PageTable("", ("µs", *QUANTILES), rows))
    word, colour = ("PASS", "green") if figures["valid"] else ("FAIL", "red")
    yield Text.assemble(
        (word, colour),
        f"  {figures['ticks']} ticks, {figures['deadline_misses']} missed, "
        f"{figures['frames_lost']} frames lost",
    )
    if figures["pace"] == "lockstep":
        yield f"in lock step, {figures['speed']:.1f} times as fast as real time"
    yield from bus_lines(figures)
    for note in figures["notes"]:
        yield Text.assemble(("note:", "yellow"), f" {note}")
