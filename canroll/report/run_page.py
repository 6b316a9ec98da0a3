"""The report page of one run, in virtual or real time."""

import platform
import re
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from canroll.plant_sim.bodies.ports import WHEELS
from canroll.plant_sim.driving.maneuvers import written
from canroll.plant_sim.driving.standards import cones_of
from canroll.plant_sim.world.spool import pieces
from canroll.report.curves import Shown, all_figures
from canroll.report.figure import Figure, Series, histogram, pack
from canroll.report.page import Cell, Page, PageTable, PageVerdict, render
from canroll.report.tables import (
    RUN_NAMES,
    authentication_note,
    can_rows,
    metric_head,
    metric_rows,
    number,
    reaction_tables,
    replay_note,
    standard_rows,
)
from canroll.report.workbench import workbench
from canroll.runs.result import Result
from canroll.runs.trace import Trace
from canroll.setup.delay import RUN_TIME
from canroll.typing import Vector
from canroll.vehicles import Vehicle

STANDARD_HEAD = ("", "criterion", "clause", "measured", "limit", "")
NLT = (
    "NLT: normalised load transfer (F right − F left)/(F right + F left) of an axle, 1 with a "
    "wheel in the air."
)
NO_ROLL = (
    f"{NLT} No roll at all: load transfer of a rigid body, the least that any roll control can "
    "reach. Blank on banked or uneven roads and with a wheel in the air, where it is undefined."
)
PLAYBACK_STEP = 0.02
"""Least time between two pictures of the playback, s."""
PICTURES = 30_000
"""Most pictures of a playback; those of a longer run are further apart."""
TIMING_PLOTS = (
    ("jitter", "Start after the deadline", (("tick", "start_jitter"), ("plant", "plant_jitter"))),
    ("tick", "Duration of a tick, including its frames", (("tick", "tick"),)),
    ("latency", "Sample to force", (("commands", "latency"),)),
)
"""Id, title and histograms (name of the curve, key) of each plot of timing."""
PLAYED = ("x", "y", "yaw", "roll", *(f"wheel_load_{wheel}" for wheel in WHEELS))


def shown(result: Result) -> list[Shown]:
    """Return the runs of a result as the plots show them."""
    runs = [Shown("without control", result.passive, 0, controlled=False)]
    if result.controlled is not None:
        runs.append(Shown("with control", result.controlled, 1, controlled=True))
    return runs


def verdict(result: Result) -> PageVerdict:
    """Return the verdict on top: headline, grounds, and whether the runs meet the standard."""
    headline, _, text = result.verdict.partition(": ")
    met: dict[str, list[str]] = {"met": [], "not met": []}
    for name, judged in () if result.not_valid else reversed(result.standard.runs()):
        met["met" if judged.passed else "not met"].append(RUN_NAMES[name])
    parts = ", ".join(f"{word} {' and '.join(runs)}" for word, runs in met.items() if runs)
    standard = f". {result.standard.name}: {parts}." if parts else ""
    return PageVerdict(result.good, headline, text[:1].upper() + text[1:] + standard)


def name_and_note(title: str) -> tuple[str, str]:
    """Return a vehicle's title up to its first comma outside brackets, and what follows."""
    matched = re.match(r"((?:\([^)]*\)|[^,])*)(?:, *(.*))?", title, re.DOTALL)
    assert matched is not None
    return matched[1], matched[2] or ""


def parameters(result: Result) -> list[tuple[str, str]]:
    """Return the settings of a run as pairs of text."""
    settings, delay = result.settings, result.delay
    rows = [
        ("manoeuvre", f"{settings.scenario}, {settings.speed * 3.6:g} km/h"),
        *((f"manoeuvre: {key}", text) for key, text in written(result.options).items()),
        *(("fault", text) for text in settings.faults),
        *((f"condition: {key}", str(value)) for key, value in settings.conditions),
        ("vehicle", f"{settings.vehicle_name}: {settings.vehicle.title}"),
        ("plant", settings.plant),
        ("actuator", settings.actuator),
        ("law", settings.law_name),
        ("observer", settings.observer),
        ("bus", settings.bus_name),
        ("loop", f"every {settings.tick * 1e3:g} ms, frames after {RUN_TIME * 1e6:g} µs"),
        ("commands", "event-triggered" if result.record.event_trigger else "every tick"),
        ("firmware run by", settings.backend),
        ("seed", str(settings.seed)),
        (
            "sample to force",
            f"{delay.least * 1e3:.1f} to {delay.most * 1e3:.1f} ms by the bounds of this bus",
        ),
    ]
    return rows + [(f"gains: {k}", _plain(v)) for k, v in result.tables["gains"].items()]


def provenance(result: Result) -> list[tuple[str, str]]:
    """Return the provenance of the numbers."""
    vehicle = result.settings.vehicle
    numbers = [
        (f"vehicle: {path}", f"{_plain(value)}; {vehicle.source(path)}")
        for path, value in _leaves(vehicle.document, "")
    ]
    return [
        ("canroll", version("canroll")),
        ("Python", platform.python_version()),
        ("calibration id", f"{result.record.id:#010x}"),
        ("vehicle data", vehicle.basis),
        *numbers,
    ]


def _leaves(table: Mapping[str, Any], path: str) -> Iterator[tuple[str, Any]]:
    """Yield each number of a vehicle's document by its dotted key."""
    for key, value in table.items():
        if isinstance(value, Mapping) and key != "sources":
            yield from _leaves(value, f"{path}{key}.")
        elif path:
            yield f"{path}{key}", value


def _plain(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, list):
        return "[" + ", ".join(_plain(item) for item in value) + "]"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_plain(item)}" for key, item in value.items())
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def run_page(result: Result) -> str:
    """Return the report page of a run as one HTML document."""
    settings = result.settings
    runs = shown(result)
    start = _leans_most(runs[0].trace)
    trigger = result.trigger
    rates = (
        f"Bus load {100 * result.can.load:.1f} %. {trigger.sent} commands in {trigger.samples} "
        f"ticks: transmission rate {100 * trigger.transmission_rate:.1f} %, "
        f"{100 * trigger.transmission_rate_triggered:.1f} % without heartbeats; heartbeats alone: "
        f"{100 * trigger.floor:.0f} %."
    )
    if (note := authentication_note(result)) is not None:
        rates += f" {note[:1].upper()}{note[1:]}."
    head = metric_head(result, "without control", "with control")
    judged = [] if result.not_valid else standard_rows(result)
    reaction = reaction_tables(result)
    tables = [
        PageTable("Figures", head, metric_rows(result), f"{NO_ROLL} {replay_note(result)}".strip()),
        *([PageTable(result.standard.name, STANDARD_HEAD, judged)] if judged else []),
        *reaction[1:],
        *([timing_table(result.timing)] if result.timing else []),
    ]
    times = PageTable(
        "Times on the bus",
        ("", "least", "mean", "most"),
        can_rows(result),
        rates,
    )
    scenario = settings.scenario.replace("_", " ")
    name, note = name_and_note(settings.vehicle.title)
    cones = cones_of(settings.scenario, settings.vehicle)
    subtitle = (
        f"{settings.vehicle_name} at {settings.speed * 3.6:.0f} km/h, "
        f"{settings.law_name} with {settings.actuator} over {settings.bus_name}"
    )
    return render(
        Page(
            title=f"{scenario[:1].upper()}{scenario[1:]}, {name}",
            subtitle=f"{note[:1].upper()}{note[1:]}. {subtitle}" if note else subtitle,
            verdict=verdict(result),
            warnings=result.warnings,
            tables=tables,
            figures=[
                *all_figures(runs, cones),
                *(timing_figures(result.timing) if result.timing else []),
            ],
            playback=playback(runs, settings.vehicle, cones),
            parameters=parameters(result),
            provenance=provenance(result),
            result=result.to_json(),
            greyed=bool(result.not_valid),
            foot={"bus": [times, *reaction[:1]]},
            workbench=workbench(result, runs, f"{scenario}, {subtitle}", start),
        )
    )


def playback(runs: Sequence[Shown], vehicle: Vehicle, cones: Vector) -> dict[str, object]:
    """Return the data of the playback; at most four cars, the first being the reference.

    ``cones``: their positions, (n, 2) in m.
    """
    step = max(PLAYBACK_STEP, *(run.trace.duration / PICTURES for run in runs))
    first = next(pieces(runs[0].trace.signals, *(f"wheel_load_{wheel}" for wheel in WHEELS)))
    cars = [
        {
            "name": run.name,
            "colour": run.colour,
            "signals": dict(zip(PLAYED, map(pack, _resampled(run.trace, step)), strict=True)),
        }
        for run in runs[:4]
    ]
    geometry = vehicle.geometry
    return {
        "step": step,
        "start": _leans_most(runs[0].trace),
        "cars": cars,
        "cones": cones.tolist(),
        "vehicle": {
            "half_track": (geometry.half_track_front + geometry.half_track_rear) / 2,
            "width": geometry.width,
            "height": 2 * vehicle.sprung_cg_height,
            "roll_centre": (geometry.roll_centre_height_front + geometry.roll_centre_height_rear)
            / 2,
            "front": geometry.cg_to_front_axle,
            "rear": geometry.cg_to_rear_axle,
            "static_load": float(np.nan_to_num(np.mean([loads[0] for loads in first]))),
        },
    }


def _leans_most(trace: Trace) -> float:
    """Return when the roll angle is largest, s."""
    moments = []
    for time, roll in pieces(trace.signals, "time", "roll"):
        place = int(np.argmax(np.abs(roll)))
        moments.append((abs(float(roll[place])), float(time[place])))
    return max(moments, key=lambda moment: moment[0])[1]


def _resampled(trace: Trace, step: float) -> list[Vector]:
    """Return each of ``PLAYED`` every ``step`` seconds from 0 to the end of the run."""
    end = max(float(time[-1]) for (time,) in pieces(trace.signals, "time"))
    wanted = np.arange(0.0, end, step)
    resampled = [np.empty(len(wanted)) for _ in PLAYED]
    first, before = 0, None
    for piece in pieces(trace.signals, "time", *PLAYED):
        # a plant without wheel loads has NaN, which the page cannot hold
        columns = np.nan_to_num(piece)
        if before is not None:
            columns = np.hstack([before, columns])
        last = int(np.searchsorted(wanted, columns[0, -1]))
        for values, column in zip(resampled, columns[1:], strict=True):
            values[first:last] = np.interp(wanted[first:last], columns[0], column)
        first, before = last, columns[:, -1:]
    return resampled


def timing_table(timing: Mapping[str, Any]) -> PageTable:
    """Return the quantiles of ``timing`` as printed by ``canroll hil --json``."""
    from canroll.hil.timing_rows import QUANTILES, ROWS, bus_lines  # noqa: PLC0415 - of real time alone

    rows: list[list[str | Cell]] = [
        [
            f"{name} (µs)",
            *(number(timing[key][q], 0, f"timing.{key}.{q}") for q in QUANTILES),
        ]
        for key, name in ROWS.items()
        if timing[key] is not None
    ]
    heading = (
        f"{timing['ticks']} ticks, {timing['deadline_misses']} missed, {timing['frames_lost']} "
        "frames lost."
    )
    seen = [f"{line}." for line in bus_lines(timing)]
    title = "Lock step" if timing["pace"] == "lockstep" else "Real time"
    return PageTable(title, ("", *QUANTILES), rows, " ".join([heading, *seen, *timing["notes"]]))


def timing_figures(timing: Mapping[str, Any]) -> list[Figure]:
    """Return the histograms of a run in real time."""
    return [
        Figure(
            f"timing-{id}", title, "µs", "% of all",
            [_bars(name, counts[key], place) for place, (name, key) in enumerate(curves, 1)],
            unit="µs", group="timing", linked=False, zero=True,
        )
        for counts in (timing["histograms"],)
        for id, title, curves in TIMING_PLOTS
        if all(counts[key]["count"] for _, key in curves)
    ]  # fmt: skip


def _bars(name: str, counted: Mapping[str, Any], colour: int) -> Series:
    """Return the bars of counts by whole µs."""
    values = [int(value) for value in counted["histogram"]]
    counts = list(counted["histogram"].values())
    return histogram(name, np.repeat(values, counts), colour=colour)
