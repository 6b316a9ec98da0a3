"""Runs behind the tables, each driven once, and the quantities taken from them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from canroll.extensions.papers.paper_table import PaperRow, PaperSection
from canroll.firmware.state import ACTIVE, DEGRADED
from canroll.report.curves import dash as dashes
from canroll.report.figure import DASHED, Figure, Series
from canroll.runs.metrics import moment
from canroll.runs.result import Result
from canroll.runs.trace import Trace
from canroll.studies.comparison import runs
from canroll.vehicles import GRAVITY

SETTLED = 0.3
"""Time after control began from which estimates are judged, s."""


@dataclass(frozen=True, slots=True)
class Headline:
    """What a law is for: a quantity of a row that is below that of the row without control."""

    table: str
    passive: str
    active: str
    quantity: str


@dataclass(frozen=True, slots=True)
class Recomputed:
    """Recomputed paper.

    Attributes:
        rows: without verdicts.
        figures: plots.
        proofs: errata, unknowns and waterfall, shown before the rows.
        sections: shown after them.
        headlines: what its systems achieve.
    """

    rows: Sequence[PaperRow]
    figures: Sequence[Figure]
    proofs: Sequence[PaperSection] = ()
    sections: Sequence[PaperSection] = ()
    headlines: Sequence[Headline] = ()


@dataclass(frozen=True, slots=True)
class PaperCase:
    """One run of a table: its row, and the keywords of :func:`canroll.run`."""

    row: str
    keywords: Mapping[str, Any]


def drive(
    scenario: str, cases: Sequence[PaperCase], common: Mapping[str, Any]
) -> dict[str, Result]:
    """Return the result of every case by its row; they share the run without control."""
    wanted = [(case.row, case.keywords) for case in cases]
    return {named.name: named.result for named in runs(scenario, wanted, common=common)}


def controlled_ticks(trace: Trace) -> Any:  # noqa: ANN401
    """Return the ticks in which the estimate has settled and control is active."""
    active = np.isin(trace.ticks["mode"], (ACTIVE, DEGRADED))
    if not np.any(active):
        return trace.ticks[:0]
    first = trace.ticks["t"][np.argmax(active)] + SETTLED
    return trace.ticks[active & (trace.ticks["t"] >= first)]


def roll_error_deg(trace: Trace) -> float:
    """Return the largest error of the estimated roll angle, deg."""
    ticks = controlled_ticks(trace)
    true = np.interp(ticks["t"], trace.signals["time"], trace.signals["roll"])
    return float(np.degrees(np.max(np.abs(ticks["roll"] - true), initial=0.0)))


def lateral_error(trace: Trace) -> float:
    """Return the largest error of the estimated effective lateral acceleration, m/s²."""
    ticks = controlled_ticks(trace)
    signals = trace.signals
    effective = signals["ay"] + GRAVITY * np.sin(signals["bank"])
    true = np.interp(ticks["t"], signals["time"], effective)
    return float(np.max(np.abs(ticks["lateral_acceleration"] - true), initial=0.0))


def plots(paper: str, title: str, results: Mapping[str, Result]) -> list[Figure]:
    """Return roll angle, delivered moment and spectrum of the command of several runs."""
    names, first = list(results), next(iter(results.values()))
    degrees = float(np.degrees(1))
    time = first.passive.signals["time"]
    free = "without control"
    if any(result.passive is not first.passive for result in results.values()):
        free = f"{names[0].rpartition(', ')[2]}, {free}"
    roll = [Series(free, time, first.passive.signals["roll"] * degrees, 0, DASHED)]
    moments, spectra = [], []
    for place, (name, result) in enumerate(results.items()):
        trace = result.controlled
        if trace is None:
            continue
        colour, dash = 1 + place % 7, dashes(1 + place)
        label = name.rpartition(", ")[2]
        time = trace.signals["time"]
        roll.append(Series(label, time, trace.signals["roll"] * degrees, colour, dash))
        moments.append(Series(label, time, moment(trace), colour, dash))
        spectra.append(Series(label, *spectrum(trace), colour, dash))
    return [
        Figure(f"{paper}-roll", f"{title}: roll angle", "time (s)", "deg", roll,
               unit="s", group=paper, linked=False),
        Figure(f"{paper}-moment", f"{title}: anti-roll moment", "time (s)", "N·m", moments,
               unit="s", group=paper, linked=False),
        Figure(f"{paper}-spectrum", f"{title}: spectrum of the command", "Hz", "dB N²m²/Hz",
               spectra, unit="Hz", group=paper, linked=False,
               note="a peak above the manoeuvre's 1 Hz means chatter or oscillation"),
    ]  # fmt: skip


def spectrum(trace: Trace) -> tuple[Any, Any]:
    """Return the power spectral density of the moment command: Hz, dB of N²m²/Hz."""
    ticks = trace.ticks
    values = ticks["moment"] - np.mean(ticks["moment"])
    step = float(ticks["t"][1] - ticks["t"][0])
    window = np.hanning(len(values))
    power = np.abs(np.fft.rfft(values * window)) ** 2 * 2 * step / np.sum(window**2)
    return np.fft.rfftfreq(len(values), step), 10 * np.log10(np.maximum(power, 1e-3))
