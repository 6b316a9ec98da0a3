"""Redondo 2021: whether a command chatters, from its spectrum and the search for limit cycles."""

from collections.abc import Mapping

import numpy as np

from hil.papers.section import Section, Value
from hil.runs.metrics import Vector
from hil.runs.result import Result

FAST = 3.0
"""Frequency above which neither manoeuvre nor body asks for a moment, Hz."""


def fast_share(values: Vector, step: float, *, above: float = FAST) -> float:
    """Return the share of the variance of ``values`` (every ``step`` s) above a frequency, Hz."""
    power = np.abs(np.fft.rfft((values - np.mean(values)) * np.hanning(len(values)))) ** 2
    total = float(np.sum(power))
    fast = np.fft.rfftfreq(len(values), step) > above
    return float(np.sum(power[fast])) / total if total else 0.0


def chatter(results: Mapping[str, Result]) -> Section:
    """Return a row a run: what of its command is fast, and the limit cycle if there is one."""
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
    return Section(
        "chatter",
        "Does the command chatter?",
        {
            "run": "run",
            "fast_percent": f"power above {FAST:g} Hz (%)",
            "moment_max_nm": "moment asked, max (N·m)",
            "limit_cycle": "limit cycle",
        },
        rows,
        "The paper finds its control input below 1.5 Hz. The delay-aware gain agrees; the "
        "delay-unaware one, as printed, is a limit cycle between the actuators' limits.",
    )
