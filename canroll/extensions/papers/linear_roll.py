"""Gains behind the tables, and whether their commands chatter."""

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import Any

import numpy as np

from canroll.extensions.papers.paper_table import PaperSection, Value, digits, finite, printed
from canroll.gain_gen.laws.declared import built_in
from canroll.runs.experiment import plan
from canroll.runs.result import Result
from canroll.typing import Vector

FAST = 3.0
"""Frequency above which neither manoeuvre nor body asks for a moment, Hz."""


def fast_share(values: Vector, step: float, *, above: float = FAST) -> float:
    """Return the share of the variance of ``values`` (every ``step`` s) above a frequency, Hz."""
    power = np.abs(np.fft.rfft((values - np.mean(values)) * np.hanning(len(values)))) ** 2
    total = float(np.sum(power))
    fast = np.fft.rfftfreq(len(values), step) > above
    return float(np.sum(power[fast])) / total if total else 0.0


def chatter(results: Mapping[str, Result]) -> PaperSection:
    """Return one row per run: share of fast command power, and any limit cycle."""
    rows: list[dict[str, Value]] = []
    for name, result in results.items():
        assert result.controlled is not None
        ticks = result.controlled.ticks
        step = float(ticks["t"][1] - ticks["t"][0])
        rows.append(
            {
                "run": name.replace("_", " "),
                "fast_percent": 100 * fast_share(ticks["moment"], step),
                "moment_max_nm": float(np.max(np.abs(ticks["moment"]))),
                "limit_cycle": str(result.limit_cycle) if result.limit_cycle else "none",
            }
        )
    return PaperSection(
        "chatter",
        "Does the command chatter?",
        {
            "run": "run",
            "fast_percent": f"power above {FAST:g} Hz (%)",
            "moment_max_nm": "moment command, max (N·m)",
            "limit_cycle": "limit cycle",
        },
        rows,
        "The paper reports control action below 1.5 Hz. The delay-aware gain agrees; the "
        "delay-unaware gain, as printed, causes a limit cycle between the actuator limits.",
    )


MS = 1e3
NOTE = (
    "γ: exact H∞ level on a frequency grid, independent of the theorem used for the design, at "
    "the longest delay that the law accounts for on this network (hinf_nodelay: none); none: the "
    "loop is unstable there, or the law has no level. Least γ: the lowest that a gain of this "
    "structure can achieve at that delay. Admits: largest constant delay from sample to force at "
    "which the design model is stable; any: stable at every delay."
)


def design_numbers(
    paper: str, common: Mapping[str, Any], laws: Sequence[str], why: str
) -> PaperSection:
    """Return one row per law: gain, level and largest delay, printed and recomputed.

    Args:
        paper: its key.
        common: keywords of the paper's runs.
        laws: names.
        why: what the printed gains are read as, and why they differ.
    """
    theorems = built_in(lambda declared: "theorem" in declared.gains)
    level = printed(paper).get("gamma_squared")
    rows: list[dict[str, Value]] = []
    for law in laws:
        row: dict[str, Value] = {"law": law}
        for column in ("as_printed", "computed"):
            gains = "theorem" if column == "computed" and law in theorems else column
            keywords = {**common, "law": law, "gains": gains}
            _, controller = plan("double_lane_change", **keywords)
            margins = controller.tables["margins"]
            most = finite(MS * margins["max_delay_s"])
            row |= {
                f"gain_{column}": _gain(controller.tables["gains"]),
                f"gamma_{column}": finite(margins.get("gamma", float("nan"))),
                f"admitted_delay_ms_{column}": "any" if most is None else most,
            }
        row["gamma_printed"] = None if level is None else sqrt(level)
        row["gamma_least"] = finite(margins.get("exact_best_gamma", float("nan")))
        rows.append(row)
    columns = {
        "law": "law",
        "gain_as_printed": "gain, printed (N·m per rad, N·m·s per rad)",
        "gain_computed": "recomputed",
        "gamma_printed": "γ, printed",
        "gamma_as_printed": "γ of the printed gain",
        "gamma_computed": "γ recomputed",
        "gamma_least": "least γ",
        "admitted_delay_ms_as_printed": "printed gain admits (ms)",
        "admitted_delay_ms_computed": "recomputed gain admits (ms)",
    }
    return PaperSection(
        "design", "The gains behind the tables", columns, rows, f"{NOTE} {why}", upright=True
    )


def _gain(gains: Mapping[str, Any]) -> str:
    """Return roll-rate gain, or the gains on roll angle and rate, of u = −K x."""
    if "output_gain" in gains:
        return digits(-gains["output_gain"][0], 4)
    return ", ".join(digits(value, 4) for value in gains["feedback"][:2])
