"""Yim 2020: LQR, H∞ and SMC with disturbance feedforward and observer, bars and dampers."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from canroll.typing import Progress
from hil.papers.linear_roll import design_numbers
from hil.papers.paper_runs import (
    Case,
    Recomputed,
    cycle_reason,
    drive,
    lateral_error,
    plots,
    roll_error_deg,
)
from hil.papers.paper_table import Row, Section, Value, printed
from hil.report.figure import Figure
from hil.runs.metrics import rms
from hil.runs.result import Result

LAWS = ("lqr", "hinf", "smc")
ACTUATORS = ("bars", "dampers")


def case_1(common: Mapping[str, Any], report: Progress) -> Section:
    """Return case 1 for both actuators, each law without and with feedforward.

    Args:
        common: keywords of the paper's runs.
        report: called with a title and the share done.
    """
    rows: list[dict[str, Value]] = []
    for actuator in ACTUATORS:
        cases = [
            Case(
                f"case 1 with {actuator}, {law}{' with feedforward' * forward}",
                {"law": law, "feedforward": forward},
            )
            for forward in (False, True)
            for law in LAWS
        ]
        keywords = {**common, "actuator": actuator, "observer": "reference"}
        results = drive("moose", cases, keywords, report)
        first = next(iter(results.values()))
        rows.append(_row(actuator, "passive", first, controlled=False))
        rows += [
            _row(actuator, name.rpartition(", ")[2], result, controlled=True)
            for name, result in results.items()
        ]
    return Section(
        "case_1",
        "Case 1: true roll angle and lateral acceleration, no observer",
        {
            "actuator": "actuator",
            "law": "law",
            "roll_max_deg": "roll max (deg)",
            "roll_rate_max_deg_s": "rate max (deg/s)",
            "moment_max_nm": "moment command, max (N·m)",
            "moment_step_rms_nm": "RMS change per tick (N·m)",
        },
        rows,
        "The paper prints no numbers for this case; figures 7, 8 and 11 show that it is close to "
        "cases 2 and 3 except for the noise of the moment. RollReference carries the true "
        "signals of the plant, so the remaining change per tick is the motion itself.",
    )


def _row(actuator: str, law: str, result: Result, *, controlled: bool) -> dict[str, Value]:
    metrics = result.controlled_metrics if controlled else result.passive_metrics
    assert metrics is not None
    asked = np.zeros(2)
    if controlled and result.controlled is not None:
        asked = result.controlled.ticks["moment"]
    return {
        "actuator": actuator,
        "law": law,
        "roll_max_deg": metrics.roll_max_deg,
        "roll_rate_max_deg_s": metrics.roll_rate_max_deg_s,
        "moment_max_nm": float(np.max(np.abs(asked))),
        "moment_step_rms_nm": rms(np.diff(asked)),
    }


PAPER = "yim2020"
TITLE = "Yim 2020: active roll stabilisation with disturbance feedforward"
COMMON = {
    "vehicle": "suv_2020",
    "plant": "nonlinear",
    "speed_kmh": 80.0,
    "options": {"friction": 0.6},
    "gains": "as_printed",
    "observer": "one_sensor",
    "trigger": "every",
}
TABLES: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("aarb_case2", "Table 3, bars, case 2", {"actuator": "bars"}),
    ("aarb_case3", "Table 4, bars, case 3", {"actuator": "bars", "identification": True}),
    ("cdc_case2", "Table 5, dampers, case 2", {"actuator": "dampers"}),
    ("cdc_case3", "Table 6, dampers, case 3", {"actuator": "dampers", "identification": True}),
)
PASSIVE_COLUMNS = ("roll_max", "roll_rate_max")
FEEDBACK_COLUMNS = (*PASSIVE_COLUMNS, "moment_max", "roll_error_max")
COLUMNS = (*FEEDBACK_COLUMNS, "lateral_error_max")
MANOEUVRE = (
    "driver, course and springs of the paper's 27-DOF car are not printed; the plant is "
    "calibrated on the passive roll angle only"
)
FEEDFORWARD = (
    "u = −m h â_y cancels the disturbance except for the actuator lag; the printed residual "
    "implies an error of m h or of the roll stiffness that the paper does not state"
)
GAINS = (
    "the printed gains do not follow from the printed tables, and here they act on a plant "
    "calibrated on the passive run, which is softer than the printed one"
)
DAMPERS = (
    "a damper only resists its stroke and cannot hold a roll angle, and the plant calibrated on "
    "the passive run is soft; the paper's damper curve is not printed"
)
ASKED = (
    "the commanded moment follows the roll angle, which the dampers reduce less than printed; "
    "the paper's damper curve is not printed"
)
ESTIMATES = (
    "the roll angle is not observable from the roll rate alone: its error is determined by gyro "
    "bias and noise, which are not printed"
)

RECOMPUTED = (
    "The printed gains do not follow from the printed weights and vehicle as interpreted here; "
    "for H∞ and SMC the paper also leaves design choices open."
)


def recompute(report: Progress) -> Recomputed:
    """Return every number of Tables 3 to 6, and the observer-free case 1, which has none."""
    found: list[Row] = []
    figures: list[Figure] = []
    for key, table, keywords in TABLES:
        numbers = printed(PAPER)[key]
        cases = [
            Case(
                f"{table}, {row}",
                {"law": row.removesuffix("_dff"), "feedforward": row.endswith("_dff")},
            )
            for row in numbers
            if row != "passive"
        ]
        results = drive("moose", cases, {**COMMON, **keywords}, report)
        if key == "aarb_case2":
            figures = plots(PAPER, "Obstacle avoidance with bars", results)
        for row, values in numbers.items():
            result = results.get(f"{table}, {row}") or next(iter(results.values()))
            names = PASSIVE_COLUMNS if row == "passive" else COLUMNS[: len(values)]
            found += [
                Row(
                    paper=PAPER,
                    table=table,
                    row=row.replace("_dff", " with feedforward"),
                    quantity=quantity,
                    printed=float(value),
                    ours=_figure(result, quantity, passive=row == "passive"),
                    group=f"{key}.{quantity}",
                    finding=_reason(key, row, quantity, result),
                    calibrated=row == "passive" and quantity == "roll_max",
                )
                for quantity, value in zip(names, values, strict=True)
            ]
    bars = {**COMMON, "actuator": "bars", "observer": "two_sensors"}
    designed = design_numbers(PAPER, bars, LAWS, RECOMPUTED)
    return Recomputed(found, figures, [designed, case_1(COMMON, report)])


def _figure(result: Result, quantity: str, *, passive: bool) -> float:
    metrics = result.passive_metrics if passive else result.controlled_metrics
    assert metrics is not None
    if quantity == "roll_max":
        return metrics.roll_max_deg
    if quantity == "roll_rate_max":
        return metrics.roll_rate_max_deg_s
    assert result.controlled is not None
    if quantity == "moment_max":
        # the paper's M_d is what the controller asks for
        return float(np.max(np.abs(result.controlled.ticks["moment"])))
    if quantity == "roll_error_max":
        return roll_error_deg(result.controlled)
    return lateral_error(result.controlled)


def _reason(key: str, row: str, quantity: str, result: Result) -> str:
    if row == "passive":
        return MANOEUVRE
    if reason := cycle_reason(result):
        return reason
    if "error" in quantity:
        return ESTIMATES
    if key.startswith("cdc"):
        return ASKED if quantity == "moment_max" else DAMPERS
    if quantity == "roll_rate_max":
        return MANOEUVRE
    return FEEDFORWARD if row.endswith("_dff") else GAINS
