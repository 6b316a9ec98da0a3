"""Yim 2020, case 1: the laws fed with the true roll angle and a_y instead of estimates.

The paper shows it in figures alone, without a number; the signals come by RollReference.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hil.papers.paper_runs import Case, drive
from hil.papers.printed_rows import Report
from hil.papers.section import Section, Value
from hil.runs.metrics import rms
from hil.runs.result import Result

LAWS = ("lqr", "hinf", "smc")
ACTUATORS = ("bars", "dampers")


def case_1(common: Mapping[str, Any], report: Report) -> Section:
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
            "moment_max_nm": "moment asked, max (N·m)",
            "moment_step_rms_nm": "RMS change per tick (N·m)",
        },
        rows,
        "The paper prints no number for this case: figures 7, 8 and 11 show it, near those of "
        "cases 2 and 3 but for the noise in the moment. RollReference carries the plant's true "
        "signals, so that what is left in the change per tick is the motion itself.",
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
