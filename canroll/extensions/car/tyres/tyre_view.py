"""A fitted tyre for readers: the answer in lines, its table, its file, and a picture."""

from collections.abc import Iterator
from math import degrees
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from canroll.errors import writing
from canroll.extensions.car.identification.fit_page import with_spread
from canroll.extensions.car.identification.unknowns import STATES
from canroll.extensions.car.tyres.measured import MeasuredTyre, levels
from canroll.extensions.car.tyres.tyre_fit import SAME_ANGLE, TyreFit, lateral_forces
from canroll.report.page import Cell, PageTable
from canroll.vehicles.tyres import tir_text
from canroll.vehicles.tyres.magic_formula import LIMITS

MOST_LEVELS = 8
"""Most loads of which a picture has curves."""


def summary(fit: TyreFit) -> str:
    """Return the answer in a line."""
    told = len(fit.of_state("identified"))
    return (
        f"{len(fit.numbers)} lateral coefficients fitted to {len(fit.table)} points of "
        f"{fit.table.name}: {told} identified"
    )


def error_line(fit: TyreFit) -> str:
    """Return how far the fitted forces are from the measured ones, in a line."""
    table, at = fit.table, fit.largest
    most = float(np.abs(table.force).max())
    line = (
        f"lateral force: RMS difference {fit.rms:.3g} N ({100 * fit.rms / most:.2g} % of the "
        f"largest), largest {fit.errors[at]:+.3g} N at {degrees(table.slip_angle[at]):.3g}° of "
        f"slip, {table.load[at]:.0f} N, {degrees(table.camber[at]):.2g}° of camber"
    )
    return line.replace("-", "−")


def untold_lines(fit: TyreFit) -> Iterator[str]:
    """Yield what the table does not tell, and what is a guess."""
    kept = [f"{n.unknown.key} ({n.unknown.label})" for n in fit.of_state("kept")]
    if kept:
        yield f"not identifiable from the table, as before: {', '.join(kept)}"
    if fit.pairs:
        pairs = [f"{first} with {second} ({r:+.2f})" for first, second, r in fit.pairs]
        yield f"identifiable only together: {', '.join(pairs)}".replace("-", "−")
    if fit.guessed:
        yield (
            f"guessed, not of the table: {', '.join(fit.guessed)}; no aligning moment: --from "
            "START.tir gives a tyre's own"
        )


def coefficient_table(fit: TyreFit) -> PageTable:
    """Return the identified coefficients, alone or with others."""
    return PageTable(
        "Lateral coefficients",
        ("", "coefficient", "fitted", "before", ""),
        [
            (
                number.unknown.key,
                number.unknown.label,
                Cell(with_spread(number.value, number.deviation), number.value, ""),
                Cell(with_spread(number.unknown.mean, number.unknown.deviation)),
                STATES[number.state],
            )
            for number in fit.numbers
            if number.state != "kept"
        ],
    )


def file_text(fit: TyreFit, start: str = "") -> str:
    """Return the tyre property file; what the text of the start's file has besides stays."""
    notes = {key: "guessed" for key in fit.guessed}
    values = {key: number for key, number in fit.tyre.values.items() if not start}
    for number in fit.numbers:
        key = number.unknown.key
        values[key] = number.value
        told = number.state != "kept"
        notes[key] = f"fitted, ± {number.deviation:.2g}" if told else "not told by the table"
    values |= {key: fit.tyre[key] for key in LIMITS if key in fit.tyre.values}
    values["UNLOADED_RADIUS"] = fit.tyre["UNLOADED_RADIUS"]
    title = (
        f"lateral coefficients fitted to {len(fit.table)} points of {fit.table.name}, RMS "
        f"{fit.rms:.3g} N"
    )
    return tir_text.with_numbers(start or tir_text.EMPTY, values, notes, title)


def _shown(table: MeasuredTyre) -> NDArray[np.int64]:
    """Number of the curve of each point, by load; −1: another camber than the least."""
    number = levels(table.load)
    if number.max() >= MOST_LEVELS:
        edges = np.quantile(table.load, np.linspace(0.0, 1.0, MOST_LEVELS + 1)[1:-1])
        number = np.searchsorted(edges, table.load).astype(np.int64)
    least = table.camber[int(np.argmin(np.abs(table.camber)))]
    return np.where(np.abs(table.camber - least) < SAME_ANGLE, number, -1)


def draw(fit: TyreFit, path: Path) -> Path:
    """Write a picture of measured points and fitted curves for each load, at the least camber.

    Raises:
        CanrollError: the file cannot be written.
    """
    table, number = fit.table, _shown(fit.table)
    slip = np.linspace(table.slip_angle.min(), table.slip_angle.max(), 201)
    with matplotlib.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure = Figure(figsize=(8, 5), layout="constrained")
        axis = figure.subplots()
        for i, level in enumerate(level for level in np.unique(number) if level >= 0):
            of = number == level
            load, camber = float(table.load[of].mean()), float(table.camber[of].mean())
            points = np.degrees(table.slip_angle[of]), table.force[of]
            axis.plot(*points, ".", color=f"C{i}", markersize=3)
            curve = lateral_forces(
                fit.tyre, slip, np.full(len(slip), load), np.full(len(slip), camber)
            )
            axis.plot(np.degrees(slip), curve, color=f"C{i}", label=f"{load:.0f} N")
        axis.set_xlabel("slip angle (deg, ISO 8855)")
        axis.set_ylabel("lateral force (N)")
        axis.set_title(f"{fit.table.name}: points measured, curves fitted", fontsize=10, loc="left")
        axis.legend(title="load")
    with writing(path):
        # without metadata the same table gives the same bytes
        figure.savefig(path, dpi=120, metadata={"Software": None})
    return path
