"""Timing of a run in real time: quantiles as a table, and histograms."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hil.realtime.timing import QUANTILES, ROWS, bus_lines
from hil.report.figure import Figure, Series, histogram
from hil.report.page import Cell, Table
from hil.report.tables import number

PLOTS = (
    ("jitter", "Start after the deadline", (("tick", "start_jitter"), ("plant", "plant_jitter"))),
    ("tick", "Duration of a tick, including its frames", (("tick", "tick"),)),
    ("latency", "Sample to force", (("commands", "latency"),)),
)
"""Id, title and histograms (name of the curve, key) of each plot."""


def timing_table(timing: Mapping[str, Any]) -> Table:
    """Return the quantiles of ``timing`` as ``canroll hil --json`` prints it."""
    rows: list[list[str | Cell]] = [
        [
            f"{name} (µs)",
            *(number(timing[key][q], 0, f"timing.{key}.{q}") for q in QUANTILES),
        ]
        for key, name in ROWS.items()
        if timing[key] is not None
    ]
    told = (
        f"{timing['ticks']} ticks, {timing['deadline_misses']} missed, {timing['frames_lost']} "
        "frames lost."
    )
    seen = [f"{line}." for line in bus_lines(timing)]
    title = "Lock step" if timing["pace"] == "lockstep" else "Real time"
    return Table(title, ("", *QUANTILES), rows, " ".join([told, *seen, *timing["notes"]]))


def timing_figures(timing: Mapping[str, Any]) -> list[Figure]:
    """Return the histograms of a run in real time."""
    return [
        Figure(
            f"timing-{id}", title, "µs", "% of all",
            [_bars(name, counts[key], place) for place, (name, key) in enumerate(curves, 1)],
            unit="µs", group="timing", linked=False, zero=True,
        )
        for counts in (timing["histograms"],)
        for id, title, curves in PLOTS
        if all(counts[key]["count"] for _, key in curves)
    ]  # fmt: skip


def _bars(name: str, counted: Mapping[str, Any], colour: int) -> Series:
    """Return the bars of counts by whole µs."""
    values = [int(value) for value in counted["histogram"]]
    counts = list(counted["histogram"].values())
    return histogram(name, np.repeat(values, counts), colour=colour)
