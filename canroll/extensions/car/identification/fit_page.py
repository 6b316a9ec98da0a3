"""A fit for readers: the answer in a line, its tables, and the page of measured and simulated."""

from collections.abc import Iterator

import numpy as np

from canroll.extensions.car.identification.agreement import Agreement
from canroll.extensions.car.identification.drive_log import QUANTITIES
from canroll.extensions.car.identification.fit import Fit, explained
from canroll.extensions.car.identification.unknowns import (
    STATES,
    FittedNumber,
    delay_key,
    offset_key,
)
from canroll.report.figure import DASHED, Figure, Series
from canroll.report.page import Cell, Page, PageTable, PageVerdict, render

SHOWN = {"rad": ("°", np.degrees(1.0)), "rad/s": ("°/s", np.degrees(1.0)), "s": ("ms", 1e3)}
"""Units of sensors as people read them, and their factors."""


def not_of_log(fit: Fit) -> tuple[str, ...]:
    """Return the labels of the vehicle's numbers of which the log says nothing."""
    return tuple(n.unknown.label for n in fit.of_state("kept") if not n.unknown.of_log)


def explained_lines(fit: Fit) -> Iterator[str]:
    """Yield how much of the variance the fitted car explains, where fitted and where predicted."""
    yield f"variance explained: {explained(fit.agreements)}"
    if fit.predictions:
        yield f"predicted, not fitted: {explained(fit.predictions)}"


def left_line(fit: Fit) -> str:
    """Return what the residuals still contain, in a line."""
    coloured = [
        f"{QUANTITIES[one.name].label} {one.correlated:.2f} s"
        for one in fit.agreements
        if not one.white
    ]
    driven = [QUANTITIES[one.name].label for one in fit.agreements if one.driven > 1.0]
    text = f"correlated over {', '.join(coloured)}" if coloured else "white noise"
    if driven:
        return f"residuals: {text}; the model lacks an effect of steering on {', '.join(driven)}"
    return f"residuals: {text}; uncorrelated with earlier steering"


def rounded(value: float, deviation: float) -> str:
    """Return a value to the second digit of its deviation."""
    if not deviation > 0.0:
        return f"{value:.4g}"
    digits = 1 - int(np.floor(np.log10(deviation)))
    text = f"{round(value, digits):.{max(digits, 0)}f}"
    return text.replace("-", "−")


def with_spread(value: float, deviation: float) -> str:
    """Return a value and its standard deviation."""
    return f"{rounded(value, deviation)} ± {rounded(deviation, deviation)}"


HEAD = ("parameter", "fitted", "before", "unit", "")


def fitted_table(fit: Fit) -> PageTable:
    """Return the identified numbers of the vehicle, alone or with others."""
    numbers = [n for n in fit.numbers if not n.unknown.of_log and n.state != "kept"]
    return PageTable(
        "Vehicle",
        HEAD,
        [_row(number) for number in numbers],
        note="±: one standard deviation. Before: the prior, from the file where the fit starts.",
    )


def _row(number: FittedNumber) -> tuple[str | Cell, ...]:
    unknown = number.unknown
    return (
        unknown.label,
        Cell(with_spread(number.value, number.deviation), number.value, ""),
        Cell(with_spread(unknown.mean, unknown.deviation)),
        unknown.unit,
        STATES[number.state],
    )


def actuator_table(fit: Fit) -> PageTable:
    """Return what the moments of the log say of the actuators; without rows if it has none."""
    return PageTable(
        "Actuators",
        HEAD,
        [_row(number) for one in fit.actuators for number in one.numbers],
        note="Delivered = gain · lag(command(t − delay)) + offset. ±: one standard deviation.",
    )


def actuator_lines(fit: Fit) -> Iterator[str]:
    """Yield how much of each delivered moment its actuator explains, and what goes together."""
    for one in fit.actuators:
        pairs = [f"{first} with {second} ({r:+.2f})" for first, second, r in one.pairs]
        text = f"; strongly correlated: {', '.join(pairs)}" if pairs else ""
        yield (
            f"actuator {one.axle}: explains {100 * one.explained:.2f} % of its moment's variance"
            f"{text}"
        )


def _of_log(fit: Fit, keys: tuple[str, ...]) -> Iterator[str]:
    for number in fit.numbers:
        if number.unknown.key in keys and number.state == "identified":
            unit, factor = SHOWN.get(number.unknown.unit, (number.unknown.unit, 1.0))
            value = rounded(factor * number.value, factor * number.deviation)
            label = number.unknown.label.removesuffix(" offset").removesuffix(" delay")
            yield f"{label} {value} {unit}"


def measurement_line(fit: Fit) -> str:
    """Return offsets and delays of the measurement in a line."""
    names = [one.name for one in fit.agreements]
    offsets = ("log.steering_offset", *(offset_key(name) for name in names))
    delays = tuple(delay_key(name) for name in names)
    return (
        f"offsets: {', '.join(_of_log(fit, offsets)) or 'none identified'}; delay behind the "
        f"steering: {', '.join(_of_log(fit, delays)) or 'none identified'}"
    )


def _agreement_table(title: str, agreements: tuple[Agreement, ...]) -> PageTable:
    rows = []
    for one in agreements:
        unit, factor = SHOWN.get(QUANTITIES[one.name].unit, (QUANTITIES[one.name].unit, 1.0))
        rows.append(
            (
                QUANTITIES[one.name].label,
                Cell(f"{100 * one.explained:.2f}", one.explained, ""),
                Cell(f"{factor * one.rms:.3g}", one.rms, ""),
                unit,
                "white" if one.white else f"correlated over {one.correlated:.2f} s",
                "independent" if one.driven <= 1.0 else "depends on it",
            )
        )
    head = ("signal", "variance explained (%)", "RMS residual", "", "residual", "and the steering")
    return PageTable(title, head, rows)


def _figures(fit: Fit) -> list[Figure]:
    figures = []
    for i, one in enumerate(fit.agreements):
        quantity = QUANTITIES[one.name]
        unit, factor = SHOWN.get(quantity.unit, (quantity.unit, 1.0))
        time = np.concatenate([curve.piece.time for curve in fit.curves])
        measured = factor * np.concatenate([curve.piece.measured[:, i] for curve in fit.curves])
        simulated = factor * np.concatenate([curve.simulated[:, i] for curve in fit.curves])
        known = np.isfinite(measured)
        curves = [
            Series("measured", time[known], measured[known], 7),
            Series("fitted", time, simulated, 1, DASHED),
        ]
        title = f"{quantity.label[0].upper()}{quantity.label[1:]}"
        figures.append(Figure(one.name, title, "time (s)", unit, curves, unit="s"))
    return figures


def fit_page(fit: Fit) -> str:
    """Return the page as HTML."""
    measurement = [n for n in fit.numbers if n.unknown.of_log]
    kept = [n for n in fit.numbers if not n.unknown.of_log and n.state == "kept"]
    tables = [
        fitted_table(fit),
        _agreement_table("Agreement", fit.agreements),
        *([_agreement_table("Predicted, not fitted", fit.predictions)] if fit.predictions else []),
        PageTable("Measurement", HEAD, [_row(n) for n in measurement]),
    ]
    if fit.actuators:
        tables.insert(1, actuator_table(fit))
    if kept:
        tables.append(
            PageTable("From the vehicle file, not from the log", HEAD, [_row(n) for n in kept])
        )
    if fit.pairs:
        rows = [(a, b, Cell(f"{c:.3f}".replace("-", "−"), c)) for a, b, c in fit.pairs]
        tables.append(PageTable("Strongly correlated", ("parameter", "and", "correlation"), rows))
    return render(
        Page(
            title="Fitted vehicle",
            subtitle=f"{fit.start.title}, {fit.log}",
            verdict=PageVerdict(
                None,
                "Not to be trusted" if fit.coloured else "Fitted",
                "; ".join((fit.verdict, *explained_lines(fit))),
            ),
            warnings=fit.remarks,
            tables=tables,
            figures=_figures(fit),
            playback=None,
            parameters=[("vehicle", fit.start.reference), ("log", fit.log)],
            provenance=(),
            result=fit.to_json(),
        )
    )
