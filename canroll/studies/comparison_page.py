"""Report pages of several runs: a comparison, and a sweep over speeds."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from canroll.report.curves import Shown, all_figures, dash
from canroll.report.figure import DASHED, Figure, Series
from canroll.report.page import Cell, Page, PageTable, PageVerdict, render
from canroll.report.run_page import NLT, parameters, playback, provenance
from canroll.report.tables import NOTHING, number
from canroll.runs.metrics import BY_KEY, NUMBERS, Metrics
from canroll.studies.comparison import Named
from plant_sim.driving.standards import cones_of

COLOURS = 7
SAME = 0.02
"""Share of the largest roll angle without control by which runs of one car may differ."""
FIGURES_TO_CHOOSE_BY = (
    "roll_rms_deg",
    "roll_max_deg",
    "roll_rate_max_deg_s",
    "nlt_front_max",
    "moment_rms_nm",
    "moment_max_nm",
)


def comparison_json(named: Sequence[Named]) -> dict[str, Any]:
    """Return the object printed by ``canroll compare --json``."""
    return {"runs": [{"name": run.name, **run.result.to_json()} for run in named]}


def metric_table(named: Sequence[Named]) -> PageTable:
    """Return a row per metric and a column per run, the run without control first."""
    rows: list[list[str | Cell]] = []
    for metric in NUMBERS:
        figure, digits = metric.key, metric.digits
        row: list[str | Cell] = [metric.title]
        first = named[0].result.passive_metrics
        row.append(number(getattr(first, figure), digits, f"runs.0.passive.{figure}"))
        for place, run in enumerate(named):
            if run.result.controlled_metrics is None:
                row.append("")
                continue
            value = getattr(run.result.controlled_metrics, figure)
            row.append(number(value, digits, f"runs.{place}.controlled.{figure}"))
        rows.append(row)
    rows.append(
        [
            "transmission rate (%)",
            "",
            *(Cell(f"{100 * run.result.trigger.transmission_rate:.1f}") for run in named),
        ]
    )
    return PageTable("Figures", ("", "without control", *(run.name for run in named)), rows, NLT)


def summary_table(named: Sequence[Named]) -> PageTable:
    """Return a row per run with the few figures by which laws are chosen."""
    figures = FIGURES_TO_CHOOSE_BY
    head = (
        "",
        "roll RMS (deg)",
        "max",
        "rate (deg/s)",
        "NLT",
        "RMS (N·m)",
        "max",
        "sent (%)",
        "age (ms)",
    )
    passive = named[0].result.passive_metrics
    rows: list[list[str | Cell]] = [
        [
            "without control",
            *(_plain(passive, n) for n in figures),
            "",
            "",
        ]
    ]
    for run in named:
        metrics = run.result.controlled_metrics
        if metrics is not None:
            rate = f"{100 * run.result.trigger.transmission_rate:.1f}"
            cells = [_plain(metrics, n) for n in figures]
            age = run.result.can.age_ms
            rows.append([run.name, *cells, rate, "" if age is None else f"{age.mean:.1f}"])
    return PageTable("Runs", head, rows)


def _plain(metrics: Metrics, figure: str) -> Cell:
    value = getattr(metrics, figure)
    return NOTHING if value is None else Cell(f"{value:.{BY_KEY[figure].digits}f}")


def apart(named: Sequence[Named]) -> list[str]:
    """Return a line for each run whose run without control differs from the one shown."""
    first = named[0].result.passive_metrics
    return [
        f"{run.name} differs in vehicle, plant, speed or course: without control it rolls by up "
        f"to {run.result.passive_metrics.roll_max_deg:.2f}°, not {first.roll_max_deg:.2f}°"
        for run in named
        if abs(run.result.passive_metrics.roll_max_deg - first.roll_max_deg)
        > SAME * first.roll_max_deg
    ]


def best(named: Sequence[Named]) -> PageVerdict:
    """Return the run with the least largest roll angle of those that help.

    Those that meet the manoeuvre's standard come first.
    """
    helping = [run for run in named if run.result.helps]
    meeting = [run for run in helping if not run.result.outcome.fails_standard]
    if not helping:
        return PageVerdict(False, "Nothing helps", "No run reduces roll without a limit cycle")
    winner = min(meeting or helping, key=lambda run: run.result.controlled_metrics.roll_max_deg)  # type: ignore[union-attr]
    assert winner.result.controlled_metrics is not None
    moment = winner.result.controlled_metrics.moment_rms_nm
    roll = winner.result.controlled_metrics.roll_max_deg
    unmet = "" if meeting else f", {winner.result.standard.short_name} not met"
    return PageVerdict(
        True if meeting else None,
        f"Least roll: {winner.name}{unmet}",
        f"Largest roll angle {roll:.2f}° for an RMS moment of {moment:.0f} N·m. Less roll at more "
        "moment does not make a better law: consider both.",
    )


def _trade_off(named: Sequence[Named]) -> Figure:
    """RMS roll angle over RMS moment, one point per run."""
    points = [
        Series(
            run.name,
            np.array([metrics.moment_rms_nm]),
            np.array([metrics.roll_rms_deg]),
            1 + place % COLOURS,
            kind="points",
        )
        for place, run in enumerate(named)
        if (metrics := run.result.controlled_metrics) is not None
    ]
    passive = named[0].result.passive_metrics
    points.append(
        Series("without control", np.zeros(1), np.array([passive.roll_rms_deg]), 0, kind="points")
    )
    return Figure(
        "trade", "Roll against effort", "RMS moment (N·m)", "RMS roll angle (deg)", points,
        group="trade", linked=False, zero=True, note="lower and further left is better",
    )  # fmt: skip


def comparison_page(named: Sequence[Named]) -> str:
    """Return the page of a comparison as one HTML document."""
    first = named[0].result
    shown = [Shown("without control", first.passive, 0, controlled=False)]
    shown += [
        Shown(run.name, run.result.controlled, 1 + place % COLOURS, controlled=True)
        for place, run in enumerate(named)
        if run.result.controlled is not None
    ]
    warnings = [f"{run.name}: {text}" for run in named for text in run.result.warnings]
    warnings += apart(named)
    settings = first.settings
    scenario = settings.scenario.replace("_", " ")
    cones = cones_of(settings.scenario, settings.vehicle)
    return render(
        Page(
            title=f"{len(named)} runs of a {scenario}",
            subtitle=f"{settings.vehicle_name} at {settings.speed * 3.6:.0f} km/h",
            verdict=best(named),
            warnings=warnings,
            tables=[metric_table(named)],
            figures=[_trade_off(named), *all_figures(shown, cones)],
            playback=playback(shown, settings.vehicle, cones),
            parameters=[
                (f"{run.name}: {key}", value)
                for run in named
                for key, value in parameters(run.result)
            ],
            provenance=provenance(first),
            result=comparison_json(named),
        )
    )


def sweep_table(named: Mapping[str, Sequence[Named]]) -> PageTable:
    """Return a row per speed: without control, then peak roll angle and change for each law."""
    laws = list(named)
    head = ["speed (km/h)", "without control (deg)"]
    for law in laws:
        head += [f"{law} (deg)", ""]
    rows: list[list[str | Cell]] = []
    for place, run in enumerate(named[laws[0]]):
        before = run.result.passive_metrics.roll_max_deg
        row: list[str | Cell] = [f"{run.result.settings.speed * 3.6:g}"]
        row.append(number(before, 2, f"laws.{laws[0]}.{place}.passive.roll_max_deg"))
        for law in laws:
            metrics = named[law][place].result.controlled_metrics
            if metrics is None:
                row += ["", ""]
                continue
            key = f"laws.{law}.{place}.controlled.roll_max_deg"
            change = f"{100 * (metrics.roll_max_deg / before - 1):+.0f} %".replace("-", "−")
            row += [number(metrics.roll_max_deg, 2, key), change]
        rows.append(row)
    return PageTable("Largest roll angle", head, rows)


def sweep_json(named: Mapping[str, Sequence[Named]]) -> dict[str, Any]:
    """Return the object printed by ``canroll sweep --json``."""
    return {"laws": {law: [run.result.to_json() for run in runs] for law, runs in named.items()}}


def sweep_page(named: Mapping[str, Sequence[Named]]) -> str:
    """Return the page of a sweep as one HTML document."""
    first = next(iter(named.values()))
    settings = first[0].result.settings
    plots = [
        _over_speed(named, figure, name)
        for figure, name in (
            ("roll_max_deg", "Largest roll angle (deg)"),
            ("roll_rms_deg", "RMS roll angle (deg)"),
            ("roll_rate_max_deg_s", "Largest roll rate (deg/s)"),
            ("nlt_front_max", "Load transfer, front axle"),
            ("moment_rms_nm", "RMS moment (N·m)"),
            ("path_error_max_m", "Largest path error (m)"),
        )
        if getattr(first[0].result.passive_metrics, figure) is not None
    ]
    speeds = [run.result.settings.speed * 3.6 for run in first]
    everything = [run for runs in named.values() for run in runs if run.result.helps is not None]
    good = [run for run in everything if run.result.helps]
    text = f"Control helps in {len(good)} of {len(everything)} runs"
    all_help = len(good) == len(everything)
    unmet = sum(run.result.outcome.fails_standard for run in everything)
    if unmet:
        text += f", {first[0].result.standard.short_name} not met in {unmet}"
    warnings = dict.fromkeys(
        f"{law} at {run.result.settings.speed * 3.6:g} km/h: {warning}"
        for law, runs in named.items()
        for run in runs
        for warning in run.result.warnings
    )
    scenario = settings.scenario.replace("_", " ")
    return render(
        Page(
            title=f"{scenario[:1].upper()}{scenario[1:]} from {min(speeds):g} to "
            f"{max(speeds):g} km/h",
            subtitle=f"{settings.vehicle_name}, {settings.actuator} over {settings.bus_name}",
            verdict=PageVerdict(None if unmet and all_help else all_help, text, ""),
            warnings=list(warnings),
            tables=[sweep_table(named)],
            figures=plots,
            playback=None,
            parameters=parameters(first[0].result),
            provenance=provenance(first[0].result),
            result=sweep_json(named),
        )
    )


def _over_speed(named: Mapping[str, Sequence[Named]], figure: str, label: str) -> Figure:
    """One metric over speed, one curve per law and one without control."""
    first = next(iter(named.values()))
    speeds = np.array([run.result.settings.speed * 3.6 for run in first])
    passive = np.array([getattr(run.result.passive_metrics, figure) for run in first])
    curves = [Series("without control", speeds, passive, 0, DASHED)]
    for place, (law, runs) in enumerate(named.items()):
        kept = [run.result for run in runs if run.result.controlled_metrics is not None]
        if kept:
            curves.append(
                Series(
                    law,
                    np.array([result.settings.speed * 3.6 for result in kept]),
                    np.array([getattr(result.controlled_metrics, figure) for result in kept]),
                    1 + place % COLOURS,
                    dash(1 + place),
                )
            )
    return Figure(
        f"sweep-{figure.replace('_', '-')}", label, "speed (km/h)", label, curves, unit="km/h",
        group="trade", zero=True,
    )  # fmt: skip
