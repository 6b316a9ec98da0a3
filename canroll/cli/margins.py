"""``canroll margins``: margins of a calibration's integers, as tables and a picture."""

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from canroll import vehicles
from canroll.cli import design_view, terminal
from canroll.cli.options import by_key
from canroll.cli.terminal import Part
from canroll.errors import writing
from canroll.gain_gen.analysis.family import Condition, FamilyMargins
from canroll.gain_gen.analysis.margins import Margins
from canroll.gain_gen.calibration import calibration_file
from canroll.gain_gen.margin_report import (
    DelayMargin,
    MarginReport,
    admits,
    margin_report,
    task_of,
    to_json,
)
from canroll.gain_gen.models.task import UNVERIFIED
from canroll.gain_gen.monitors.detectability import Detectable, of_calibration
from canroll.gain_gen.monitors.uncertainty import stated
from canroll.report.page import PageTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes


POINT = ("", "peak", "gain (dB)", "phase (°)", "Ms")


def run(args: argparse.Namespace) -> int:
    """Analyse and report; 0 if the loop has its margins on the whole family, else 1."""
    calibration = calibration_file.load(args.calibration)
    note = vehicles.note_of_change(calibration.vehicle, "calibration")
    if note:
        print(f"note: {note}", file=sys.stderr)
    designed = stated(calibration.tables["uncertainty"], file=calibration.path)
    box = stated(by_key("--uncertainty", args.uncertainty), designed)
    report = margin_report(calibration)
    faults: Sequence[Detectable] = ()
    if args.json or args.verbose or args.uncertainty:
        faults = of_calibration(calibration.record, task_of(calibration), box)
    data = to_json(report) | {
        "without_stage": None if calibration.stage is None else calibration.stage.name,
        "verified": calibration.verified,
        "failed": calibration.failed,
        "detectability": [row.to_json() for row in faults],
    }
    parts: list[Part] = []
    if calibration.stage is not None:
        parts += terminal.warnings([without(calibration.stage.file)])
    if not calibration.verified:
        parts += terminal.warnings(t for t in calibration.warnings if t.startswith(UNVERIFIED))
    parts += shown(report)
    if args.verbose or args.uncertainty:
        parts += terminal.titled(design_view.detectability(faults, box))
    if args.out is not None:
        draw(report, args.out / "margins.png")
        parts.append(f"written: {args.out / 'margins.png'}")
    return terminal.emit(args, data, parts, good=admits(report))


def without(stage: str) -> str:
    """Note on what the margins do not cover if a calibration has a user's stage."""
    return (
        f"the margins are those of the law without the stage {stage}: a stage that multiplies its "
        "moment has them while the factor stays within the gains that are stable below; judge "
        "anything else by runs"
    )


def shown(report: MarginReport) -> Iterator[Part]:
    """Yield what was designed for, the tables and the checks."""
    delay = report.delay
    yield (
        f"{report.law} for {report.vehicle}: designed for {1e3 * delay.least:.4g} to "
        f"{1e3 * delay.most:.4g} ms from sample to force, stable for {_delay(report.max_delay)}"
    )
    yield from terminal.warnings(filter(None, [report.note]))
    conditions = tuple(
        dict.fromkeys(row.condition for row in report.family.rows if not row.condition.draw)
    )
    yield from ("", _family_table(report.family, conditions))
    yield from ("", design_view.checks(report.checks))
    yield from design_view.over_draws(report.fit, report.max_delay - delay.most)
    over_delay = [(f"{1e3 * point.delay:.0f} ms", point) for point in report.over_delay]
    over_gain = [(f"× {point.gain_factor:g}", point) for point in report.over_gain]
    for title, points in (
        (f"over delay, {conditions[0]}", over_delay),
        (f"over gain, delay {1e3 * delay.nominal:.4g} ms", over_gain),
    ):
        yield from terminal.titled(PageTable(title, POINT, [_row(*point) for point in points]))


def _family_table(family: FamilyMargins, conditions: Iterable[Condition]) -> PageTable:
    rows = []
    for condition in conditions:
        of = FamilyMargins(
            tuple(row for row in family.rows if replace(row.condition, draw=0) == condition)
        )
        gain, peak = of.worst_gain, of.worst_sensitivity
        numbers = _number(gain.margins.gain_db), _peak(peak.margins), f"{1e3 * peak.delay:.1f}"
        rows.append((str(condition), *numbers))
    over = " and draws" if any(row.condition.draw for row in family.rows) else ""
    head = (f"worst over all delays{over}", "gain (dB)", "Ms", "at (ms)")
    return PageTable("Family", head, rows)


def _delay(seconds: float) -> str:
    return f"delays up to {_number(1e3 * seconds)} ms" if isfinite(seconds) else "any delay"


def _row(label: str, point: DelayMargin) -> tuple[str, ...]:
    margins = point.margins
    if not point.stable:
        return (label, "unstable", "", "", "")
    return (
        label,
        f"{point.peak:.4f}",
        _number(margins.gain_db),
        _number(margins.phase_deg),
        _peak(margins),
    )


def _number(value: float) -> str:
    return f"{value:.1f}" if isfinite(value) else "any" if value > 0.0 else "none"


def _peak(margins: Margins) -> str:
    return f"{margins.sensitivity:.2f}" if isfinite(margins.sensitivity) else "unstable"


def draw(report: MarginReport, path: Path) -> None:
    """Write the figure: Nyquist curves by delay, roll over delay, roll over gain.

    Raises:
        CanrollError: the file cannot be written.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - half a second that only this needs

    figure = Figure(figsize=(13, 4.2), layout="constrained")
    nyquist, delay, gain = figure.subplots(1, 3)
    for seconds, curve in report.loop.items():
        nyquist.plot(curve.real, curve.imag, label=f"{1e3 * seconds:g} ms")
    nyquist.plot([-1.0], [0.0], "k+", markersize=12)
    nyquist.set(title="loop gain, Nyquist", xlabel="real", ylabel="imaginary")
    nyquist.set(xlim=(-2.2, 2.2), ylim=(-2.2, 2.2), aspect="equal")
    nyquist.legend(title="delay")
    _curve(delay, [1e3 * p.delay for p in report.over_delay], report.over_delay)
    _curve(gain, [p.gain_factor for p in report.over_gain], report.over_gain)
    delay.set_xlabel("delay from sample to force, ms")
    gain.set_xlabel("factor on the gain")
    delay.set_title("over delay (red: unstable)")
    gain.set_title("over gain (red: unstable)")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=110)


def _curve(axes: "Axes", at: list[float], points: Sequence[DelayMargin]) -> None:
    """Draw the peak response over one parameter, with a red line where the loop is unstable."""
    stable = [(x, point.peak) for x, point in zip(at, points, strict=True) if point.stable]
    axes.plot([x for x, _ in stable], [peak for _, peak in stable], "o-", label="controlled")
    axes.axhline(1.0, color="grey", linestyle="--", label="without control")
    for x, point in zip(at, points, strict=True):
        if not point.stable:
            axes.axvline(x, color="tab:red", alpha=0.25)
    axes.set(ylabel="peak of roll over roll moment, relative", ylim=(0.0, None))
    axes.legend()
