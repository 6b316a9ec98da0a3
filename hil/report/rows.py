"""The figures of a run as rows of tables, for terminal and page alike."""

from dataclasses import dataclass

from hil.report.page import Cell
from hil.result import FIGURES, Result

LABELS = {
    "roll_rms_deg": ("roll angle RMS (deg)", 2),
    "roll_max_deg": ("roll angle max (deg)", 2),
    "roll_rate_rms_deg_s": ("roll rate RMS (deg/s)", 2),
    "roll_rate_max_deg_s": ("roll rate max (deg/s)", 2),
    "nlt_front_max": ("NLT front max", 3),
    "nlt_rear_max": ("NLT rear max", 3),
    "moment_rms_nm": ("moment RMS (N·m)", 0),
    "moment_max_nm": ("moment max (N·m)", 0),
    "path_error_rms_m": ("path error RMS (m)", 3),
    "path_error_max_m": ("path error max (m)", 3),
}
"""Name and decimals of each metric."""

ALL_FIGURES = (*FIGURES, "path_error_rms_m", "path_error_max_m")
NOTHING = Cell("")


@dataclass(frozen=True, slots=True)
class Row:
    """A named row of numbers."""

    name: str
    numbers: tuple[Cell, ...]


def number(value: float, digits: int, key: str) -> Cell:
    """Return a cell for the number at ``key`` of the JSON object."""
    return Cell(f"{value:.{digits}f}".replace("-", "−"), value, key)


def change(after: float, before: float) -> Cell:
    """Return the relative change in percent, or nothing where there is nothing to compare with."""
    if before == 0:
        return NOTHING
    percent = round(100 * (after / before - 1))
    return Cell(f"{percent:+d} %".replace("-", "−") if percent else "0 %")


def metric_rows(result: Result) -> list[Row]:
    """Return a row a metric: without control, with control, change, with no roll at all."""
    rows = []
    for name in ALL_FIGURES:
        label, digits = LABELS[name]
        before = getattr(result.passive_metrics, name)
        cells = [number(before, digits, f"passive.{name}")]
        if result.controlled_metrics is None:
            cells += [NOTHING, NOTHING]
        else:
            after = getattr(result.controlled_metrics, name)
            cells += [number(after, digits, f"controlled.{name}"), change(after, before)]
        least = result.without_roll.get(name)
        cells.append(NOTHING if least is None else number(least, digits, f"without_roll.{name}"))
        rows.append(Row(label, tuple(cells)))
    return rows


def can_rows(result: Result) -> list[Row]:
    """Return a row a message with least, mean and largest response time, and the age."""
    spreads = {
        f"{name}, response (ms)": (f"can.response_ms.{name}", spread)
        for name, spread in result.can.response_ms.items()
    }
    if result.can.age_ms is not None:
        spreads["sample to force, age (ms)"] = ("can.age_ms", result.can.age_ms)
    return [
        Row(
            label,
            tuple(
                number(getattr(spread, which), 2, f"{key}.{which}")
                for which in ("min", "mean", "max")
            ),
        )
        for label, (key, spread) in spreads.items()
    ]
