"""A validation for readers: the answer in a line, its tables, and the page with its bands."""

from collections.abc import Iterator, Sequence
from math import isfinite

import numpy as np

from canroll.extensions.car.identification.drive_log import QUANTITIES
from canroll.extensions.car.identification.fit_page import SHOWN, rounded
from canroll.extensions.car.validation.criterion import Criterion, ToleranceBand
from canroll.extensions.car.validation.manoeuvre import WORDS
from canroll.extensions.car.validation.replayed import label
from canroll.extensions.car.validation.validate import Match, Validation
from canroll.report.figure import DASHED, DOTTED, Figure, Series
from canroll.report.page import Cell, Page, PageTable, PageVerdict, render

CORRIDOR = 0.05
"""Half-width of the inner corridor of ISO/TS 18571, of the largest measured value."""
_MARKS = {True: "passes", False: "fails"}


def headline(validations: Sequence[Validation]) -> str:
    """Return the answer in a line."""
    if len(validations) == 1:
        return validations[0].verdict
    vehicle = validations[0].drive.vehicle.name
    failed = [one for one in validations if not one.passed]
    unjudged = dict.fromkeys(text for one in validations for text in one.unjudged)
    missed = "".join(
        f"; {text} was not judged in {sum(text in one.unjudged for one in validations)}"
        for text in unjudged
    )
    if not failed:
        return f"{vehicle} moves as measured in {len(validations)} logs{missed}"
    return (
        f"{vehicle} does not move as measured in {len(failed)} of {len(validations)} logs: "
        f"{', '.join(one.drive.log for one in failed)}{missed}"
    )


def _mark(match: Match) -> str:
    if match.failed:
        return f"fails {', '.join(text.split()[0] for text in match.failed)}"
    return "" if match.rating is None else "passes"


def signal_table(validation: Validation) -> PageTable:
    """Return how well each signal agrees."""
    rows: list[tuple[str | Cell, ...]] = []
    for match in validation.matches:
        unit, factor = SHOWN.get(QUANTITIES[match.name].unit, (QUANTITIES[match.name].unit, 1.0))
        rating = match.rating
        rows.append(
            (
                label(match.name),
                Cell(f"{100 * match.explained:.2f}", match.explained, ""),
                Cell("" if rating is None else f"{rating.overall:.3f}"),
                "" if rating is None else rating.grade,
                Cell(f"{100 * match.error:.2f}", match.error, ""),
                Cell(f"{factor * match.rms:.3g} {unit}"),
                _mark(match),
            )
        )
    head = ("signal", "VAF %", "rating", "ISO/TS 18571", "error %", "RMS", "")
    return PageTable(
        f"{validation.drive.log}: signals",
        head,
        rows,
        note="VAF: variance accounted for. Rating: overall rating of ISO/TS 18571. Error: RMS of "
        "the difference over the largest measured value.",
    )


def figure_table(validation: Validation, most: int | None = None) -> PageTable:
    """Return the figures and bands of the manoeuvre; of more than ``most`` those that fail."""
    figures: list[Criterion | ToleranceBand] = [
        *validation.judged.criteria,
        *validation.judged.bands,
    ]
    note = ""
    if most is not None and len(figures) > most:
        shown = [one for one in figures if not one.passed][:most]
        note = f"{len(figures) - len(shown)} more figures are on the page"
        figures = shown
    rows = [_figure_row(one) if isinstance(one, Criterion) else _band_row(one) for one in figures]
    title = f"{validation.drive.log}: {WORDS[validation.manoeuvre]}"
    return PageTable(title, ("figure", "measured", "simulated", "tolerance", "", ""), rows, note)


def _figure_row(one: Criterion) -> tuple[str | Cell, ...]:
    judged = isfinite(one.tolerance)

    def shown(value: float) -> str:
        return rounded(value, one.tolerance) if judged else f"{value:.3g}".replace("-", "−")

    return (
        one.label,
        Cell(shown(one.measured), one.measured, ""),
        Cell(shown(one.simulated), one.simulated, ""),
        Cell(f"±{rounded(one.tolerance, one.tolerance)}" if judged else ""),
        one.unit,
        _MARKS[one.passed] if judged else "",
    )


def _band_row(band: ToleranceBand) -> tuple[str | Cell, ...]:
    return (
        band.title,
        "",
        Cell(f"{band.worst:.2f}", band.worst, ""),
        "1",
        "of tolerance",
        _MARKS[band.passed],
    )


def overview(validations: Sequence[Validation]) -> PageTable:
    """Return a row a log, those that fail first."""
    rows: list[tuple[str | Cell, ...]] = []
    for one in sorted(validations, key=lambda one: one.passed):
        rated = [match.rating.overall for match in one.matches if match.rating is not None]
        worst = min(rated, default=None)
        rows.append(
            (
                one.drive.log,
                WORDS[one.manoeuvre].partition(" (")[0],
                Cell(f"{one.seconds:.1f}"),
                Cell("" if worst is None else f"{worst:.3f}", worst, ""),
                _MARKS[one.passed],
                "" if one.passed else one.failures[0],
            )
        )
    return PageTable("Logs", ("log", "manoeuvre", "s", "least rating", "", "why"), rows)


def _line(validation: Validation, name: str, group: str) -> Figure:
    unit, factor = SHOWN.get(QUANTITIES[name].unit, (QUANTITIES[name].unit, 1.0))
    stretches = validation.drive.stretches
    time = np.concatenate([stretch.time for stretch in stretches])
    measured = factor * np.concatenate([stretch.measured[name] for stretch in stretches])
    simulated = factor * np.concatenate([stretch.simulated[name] for stretch in stretches])
    known = np.isfinite(measured)
    inside = np.concatenate([stretch.inside for stretch in stretches])
    width = CORRIDOR * float(np.abs(measured[known & inside]).max())
    at, values = time[known], measured[known]
    series = [
        Series("measured", at, values, 7),
        Series("simulated", time, simulated, 1, DASHED),
        Series("inner corridor of ISO/TS 18571", at, values - width, 2, DOTTED),
        Series("inner corridor, above", at, values + width, 2, DOTTED),
    ]
    title = f"{label(name)[0].upper()}{label(name)[1:]}"
    return Figure(f"{group}_{name}", title, "time (s)", unit, series, unit="s", group=group)


def _cross(band: ToleranceBand, group: str) -> Figure:
    series = [
        Series("measured", *band.measured, 7),
        Series("simulated", *band.simulated, 1, DASHED),
        Series("tolerance, below", *band.lower, 2, DOTTED),
        Series("tolerance, above", *band.upper, 2, DOTTED),
    ]
    return Figure(
        f"{group}_{band.name}_band",
        band.title,
        band.xlabel,
        band.unit,
        series,
        group=group,
        linked=False,
    )


def _figures(validation: Validation, group: str) -> Iterator[Figure]:
    for band in validation.judged.bands:
        yield _cross(band, group)
    for match in validation.matches:
        yield _line(validation, match.name, group)


def validation_page(validations: Sequence[Validation], result: dict[str, object]) -> str:
    """Return the page as HTML; ``result`` is embedded in it."""
    tables = [overview(validations)] if len(validations) > 1 else []
    figures: list[Figure] = []
    groups = {}
    for number, one in enumerate(validations):
        group = f"log{number}"
        groups[group] = one.drive.log
        tables.append(signal_table(one))
        if one.judged.criteria or one.judged.bands:
            tables.append(figure_table(one))
        figures += _figures(one, group)
    vehicle = validations[0].drive.vehicle
    good = all(one.passed for one in validations)
    warnings = [f"{one.drive.log}: {text}" for one in validations for text in one.drive.remarks]
    failures = [
        text if len(validations) == 1 else f"{one.drive.log}: {text}"
        for one in validations
        for text in one.failures
    ]
    measurement = next((one.measurement.source for one in validations), "")
    return render(
        Page(
            title="Validated vehicle",
            subtitle=vehicle.title,
            verdict=PageVerdict(
                good,
                "Validated" if good else "Not validated",
                "; ".join((headline(validations), *failures[1 if len(validations) == 1 else 0 :])),
            ),
            warnings=warnings,
            tables=tables,
            figures=figures,
            playback=None,
            parameters=[
                ("vehicle", vehicle.reference),
                *(("log", one.drive.log) for one in validations),
                ("measurement", measurement or "no offsets, no delays"),
            ],
            provenance=(),
            result=result,
            groups=groups,
        )
    )
