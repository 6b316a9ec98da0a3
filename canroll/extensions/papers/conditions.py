"""From the paper's conditions to ours: a chain of runs that differ by one thing each."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from canroll.extensions.papers.paper_runs import lateral_error, roll_error_deg
from canroll.extensions.papers.paper_table import (
    PaperRow,
    PaperSection,
    PaperStep,
    Value,
    digits,
    finite,
)
from canroll.extensions.papers.roll_loop import RollLoop, motion
from canroll.runs.result import Result
from canroll.typing import Vector
from canroll.vehicles import RollModel

Figures = Callable[[str], float]
"""A run: the value of each quantity of the tables by its name."""

IDEAL_SENSORS = {"noise": 0, "bias": 0, "filtered": "off", "delayed": "off"}
"""Ideal sensors of a run through the ECU."""
METRICS = {
    "roll_rms": "roll_rms_deg",
    "roll_max": "roll_max_deg",
    "roll_rate_rms": "roll_rate_rms_deg_s",
    "roll_rate_max": "roll_rate_max_deg_s",
    "nlt_front": "nlt_front_max",
    "nlt_rear": "nlt_rear_max",
}


@dataclass(frozen=True, slots=True)
class Chain:
    """The same case under the paper's conditions, then with one thing switched after another."""

    paper: Figures
    switched: Sequence[tuple[str, Figures]]

    def columns(self, quantity: str) -> dict[str, Any]:
        """Return the fields of a row that come from the runs."""
        steps = [PaperStep(name, figures(quantity)) for name, figures in self.switched]
        return {
            "recomputed": self.paper(quantity),
            "ours": steps[-1].value,
            "attribution": tuple(steps),
        }


def of_result(result: Result, *, passive: bool = False) -> Figures:
    """Return the figures of a run through the ECU, or of the one without control."""

    def figure(quantity: str) -> float:
        metrics = result.passive_metrics if passive else result.controlled_metrics
        assert metrics is not None
        if quantity in METRICS:
            return float(getattr(metrics, METRICS[quantity]))
        if quantity == "transmission_rate":
            return result.trigger.transmission_rate
        assert result.controlled is not None
        if quantity == "moment_max":
            # the command, as the papers print it
            return float(np.max(np.abs(result.controlled.ticks["moment"])))
        if quantity == "roll_error_max":
            return roll_error_deg(result.controlled)
        return lateral_error(result.controlled)

    return figure


def of_loop(
    loop: RollLoop, lateral: Vector, transfer: Mapping[str, float] | None = None
) -> Figures:
    """Return the figures of a loop around the roll model.

    ``transfer``: normalised load transfer by axle per degree of roll.
    """
    metrics = motion(loop, lateral)

    def figure(quantity: str) -> float:
        if transfer and quantity in transfer:
            return transfer[quantity] * metrics.figure("roll_max")
        return metrics.figure(quantity)

    return figure


def fitted_scale(model: RollModel, lateral: Vector, roll_max_deg: float) -> float:
    """Return the factor on the roll moment m h a_y that gives ``roll_max_deg`` without control."""
    return roll_max_deg / motion(RollLoop(model), lateral).figure("roll_max")


def waterfall(
    rows: Sequence[PaperRow], places: Sequence[tuple[str, str, str]], note: str
) -> PaperSection:
    """Return the chain of some rows: a line a row, a column a switch.

    Args:
        rows: of one paper.
        places: table, row and quantity of those to show; their chains switch the same things.
        note: below the table.
    """
    shown = [row for row in rows if (row.table, row.row, row.quantity) in places]
    columns = {"row": "row", "printed": "printed", "paper": "paper's conditions"}
    columns |= {step.switched: f"+ {step.switched}" for step in shown[0].attribution[:-1]}
    columns |= {"ours": f"+ {shown[0].attribution[-1].switched} = ours"}
    lines: list[dict[str, Value]] = []
    for row in shown:
        line: dict[str, Value] = {
            "row": f"{row.table.split(',')[-1].strip()}, {row.row}, {row.quantity}",
            "printed": row.printed,
            "paper": finite(row.recomputed),
        }
        line |= {step.switched: finite(step.value) for step in row.attribution[:-1]}
        lines.append(line | {"ours": row.ours})
    return PaperSection("waterfall", "From the paper's conditions to ours", columns, lines, note)


def erratum(claim: str, formula: str, finding: str) -> dict[str, Value]:
    """Return a line of the section of errata."""
    return {"claim": claim, "formula": formula, "found": finding}


def errata(lines: Sequence[Mapping[str, Value]]) -> PaperSection:
    """Return the errors in print, numbered E1, E2, …: reasons of rows name them."""
    rows = [{"number": f"E{place}", **line} for place, line in enumerate(lines, 1)]
    columns = {"number": "", "claim": "printed", "formula": "check", "found": "result"}
    return PaperSection("errata", "Errors in print", columns, rows)


def unknowns(lines: Sequence[tuple[str, str]]) -> PaperSection:
    """Return what the paper does not print, and what stands for it under its conditions."""
    rows = [{"unknown": unknown, "taken": taken} for unknown, taken in lines]
    columns = {"unknown": "not printed", "taken": "taken here"}
    return PaperSection("unknowns", "Conditions that the paper does not print", columns, rows)


def number(value: float, count: int = 3) -> str:
    """Return a number as a sentence shows it."""
    return digits(value, count).replace("-", "−")
