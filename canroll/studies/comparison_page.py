"""Report pages of several runs: a comparison, and a sweep over speeds. Tables are views of JSON."""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np

from canroll.plant_sim.driving.standards import cones_of
from canroll.report.curves import Shown, all_figures, dash
from canroll.report.figure import DASHED, Figure, Series
from canroll.report.page import Cell, Page, PageTable, PageVerdict, render
from canroll.report.run_page import NLT, parameters, playback, provenance
from canroll.report.tables import number
from canroll.runs.metrics import BY_KEY, NUMBERS
from canroll.studies.comparison import Named

COLOURS = 7
SAME = 0.02
"""Share of the largest roll angle without control by which runs of one car may differ."""
CHOSEN_BY = {
    "roll_rms_deg": "roll RMS (deg)",
    "roll_max_deg": "max",
    "roll_rate_max_deg_s": "rate (deg/s)",
    "nlt_front_max": "NLT",
    "moment_rms_nm": "RMS (N·m)",
    "moment_max_nm": "max",
}
"""The few metrics by which laws are chosen, and their heads."""
OVER_SPEED = {
    "roll_max_deg": "Largest roll angle (deg)",
    "roll_rms_deg": "RMS roll angle (deg)",
    "roll_rate_max_deg_s": "Largest roll rate (deg/s)",
    "nlt_front_max": "Load transfer, front axle",
    "moment_rms_nm": "RMS moment (N·m)",
    "path_error_max_m": "Largest path error (m)",
}
Runs = Mapping[str, Sequence[Named]]
"""The runs of each law, over the same speeds."""


def cell(data: Any, *path: str | int) -> Cell:  # noqa: ANN401
    """Return the metric at a place of the JSON object; an empty cell where there is none."""
    for key in path:
        data = None if data is None else data[key]
    return number(data, BY_KEY[str(path[-1])].digits, ".".join(map(str, path)))


def sent(run: Named) -> str:
    """Return the share of the ticks whose command was sent, %."""
    return f"{100 * run.result.trigger.transmission_rate:.1f}"


def comparison_json(named: Sequence[Named]) -> dict[str, Any]:
    """Return the object printed by ``canroll compare --json``."""
    return {"runs": [{"name": run.name, **run.result.to_json()} for run in named]}


def metric_table(named: Sequence[Named], data: Mapping[str, Any]) -> PageTable:
    """Return a row per metric and a column per run, the run without control first."""
    places = [("runs", 0, "passive"), *(("runs", i, "controlled") for i in range(len(named)))]
    rows: list[list[str | Cell]] = [
        [each.title, *(cell(data, *place, each.key) for place in places)] for each in NUMBERS
    ]
    rows.append(["transmission rate (%)", "", *(Cell(sent(run)) for run in named)])
    return PageTable("Figures", ("", "without control", *(run.name for run in named)), rows, NLT)


def summary_table(named: Sequence[Named]) -> PageTable:
    """Return a row per run with the few figures by which laws are chosen."""
    data = comparison_json(named)["runs"]
    rows: list[list[str | Cell]] = [
        ["without control", *(cell(data, 0, "passive", key) for key in CHOSEN_BY), "", ""]
    ]
    for place, run in enumerate(named):
        if run.result.controlled_metrics is not None:
            age = run.result.can.age_ms
            cells = (cell(data, place, "controlled", key) for key in CHOSEN_BY)
            rows.append([run.name, *cells, sent(run), "" if age is None else f"{age.mean:.1f}"])
    return PageTable("Runs", ("", *CHOSEN_BY.values(), "sent (%)", "age (ms)"), rows)


def apart(named: Sequence[Named]) -> list[str]:
    """Return a line for each run whose run without control differs from the one shown."""
    first = named[0].result.passive_metrics.roll_max_deg
    peaks = {run.name: run.result.passive_metrics.roll_max_deg for run in named}
    return [
        f"{name} differs in vehicle, plant, speed or course: without control it rolls by up "
        f"to {peak:.2f}°, not {first:.2f}°"
        for name, peak in peaks.items()
        if abs(peak - first) > SAME * first
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
    metrics = winner.result.controlled_metrics
    assert metrics is not None
    unmet = "" if meeting else f", {winner.result.standard.short_name} not met"
    return PageVerdict(
        True if meeting else None,
        f"Least roll: {winner.name}{unmet}",
        f"Largest roll angle {metrics.roll_max_deg:.2f}° for an RMS moment of "
        f"{metrics.moment_rms_nm:.0f} N·m. Less roll at more moment does not make a better law: "
        "consider both.",
    )


def _trade_off(named: Sequence[Named]) -> Figure:
    """RMS roll angle over RMS moment, one point per run."""
    sides = [
        (run.name, run.result.controlled_metrics, 1 + i % COLOURS) for i, run in enumerate(named)
    ]
    points = [
        Series(
            name, np.array([side.moment_rms_nm]), np.array([side.roll_rms_deg]), k, kind="points"
        )
        for name, side, k in sides
        if side is not None
    ]
    free = np.array([named[0].result.passive_metrics.roll_rms_deg])
    points.append(Series("without control", np.zeros(1), free, 0, kind="points"))
    return Figure(
        "trade", "Roll against effort", "RMS moment (N·m)", "RMS roll angle (deg)", points,
        group="trade", linked=False, zero=True, note="lower and further left is better",
    )  # fmt: skip


def comparison_page(named: Sequence[Named]) -> str:
    """Return the page of a comparison as one HTML document."""
    first, data = named[0].result, comparison_json(named)
    settings = first.settings
    shown = [Shown("without control", first.passive, 0, controlled=False)]
    shown += [
        Shown(run.name, run.result.controlled, 1 + place % COLOURS, controlled=True)
        for place, run in enumerate(named)
        if run.result.controlled is not None
    ]
    cones = cones_of(settings.scenario, settings.vehicle)
    count = "1 run" if len(named) == 1 else f"{len(named)} runs"
    return render(
        Page(
            title=f"{count} of a {settings.scenario.replace('_', ' ')}",
            subtitle=f"{settings.vehicle_name} at {settings.speed * 3.6:.0f} km/h",
            verdict=best(named),
            warnings=[f"{n.name}: {text}" for n in named for text in n.result.warnings]
            + apart(named),
            tables=[metric_table(named, data)],
            figures=[_trade_off(named), *all_figures(shown, cones)],
            playback=playback(shown, settings.vehicle, cones),
            parameters=[
                (f"{n.name}: {key}", value) for n in named for key, value in parameters(n.result)
            ],
            provenance=provenance(first),
            result=data,
        )
    )


def sweep_json(named: Runs) -> dict[str, Any]:
    """Return the object printed by ``canroll compare --json`` over several speeds."""
    return {"laws": {law: [run.result.to_json() for run in runs] for law, runs in named.items()}}


def sweep_table(named: Runs) -> PageTable:
    """Return a row per speed: without control, then peak roll angle and change for each law."""
    data, (first, *_) = sweep_json(named), named
    rows: list[list[str | Cell]] = []
    for place, run in enumerate(named[first]):
        before = run.result.passive_metrics.roll_max_deg
        row: list[str | Cell] = [f"{run.result.settings.speed * 3.6:g}"]
        row.append(cell(data, "laws", first, place, "passive", "roll_max_deg"))
        for law in named:
            after = cell(data, "laws", law, place, "controlled", "roll_max_deg")
            change = "" if after.value is None else f"{100 * (after.value / before - 1):+.0f} %"
            row += [after, change.replace("-", "−")]
        rows.append(row)
    heads = chain.from_iterable((f"{law} (deg)", "") for law in named)
    return PageTable("Largest roll angle", ("speed (km/h)", "without control (deg)", *heads), rows)


def sweep_page(named: Runs) -> str:
    """Return the page of a sweep as one HTML document."""
    first = next(iter(named.values()))
    result, settings = first[0].result, first[0].result.settings
    speeds = [run.result.settings.speed * 3.6 for run in first]
    judged = [run.result for runs in named.values() for run in runs if run.result.helps is not None]
    good = sum(each.helps is True for each in judged)
    unmet = sum(each.outcome.fails_standard for each in judged)
    text = f"Control helps in {good} of {len(judged)} runs"
    text += f", {result.standard.short_name} not met in {unmet}" if unmet else ""
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
            verdict=PageVerdict(
                None if unmet and good == len(judged) else good == len(judged), text, ""
            ),
            warnings=list(warnings),
            tables=[sweep_table(named)],
            figures=[
                _over_speed(named, key, label)
                for key, label in OVER_SPEED.items()
                if getattr(result.passive_metrics, key) is not None
            ],
            playback=None,
            parameters=parameters(result),
            provenance=provenance(result),
            result=sweep_json(named),
        )
    )


def _over_speed(named: Runs, key: str, label: str) -> Figure:
    """One metric over speed, one curve per law and one without control."""

    def curve(name: str, runs: Sequence[Named], side: str, *style: int) -> Series:
        points = [
            (run.result.settings.speed * 3.6, getattr(metrics, key))
            for run in runs
            if (metrics := getattr(run.result, f"{side}_metrics")) is not None
        ]
        return Series(name, *np.array(points).reshape(-1, 2).T, *style)

    curves = [curve("without control", next(iter(named.values())), "passive", 0, DASHED)]
    for place, (law, runs) in enumerate(named.items()):
        one = curve(law, runs, "controlled", 1 + place % COLOURS, dash(1 + place))
        curves += [one] if len(one.x) else []
    return Figure(
        f"sweep-{key.replace('_', '-')}", label, "speed (km/h)", label, curves, unit="km/h",
        group="trade", zero=True,
    )  # fmt: skip
