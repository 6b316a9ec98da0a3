"""The printed gains and levels beside what the same structure gets on the paper's design model."""

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import Any

from hil.papers.printed_rows import printed
from hil.papers.section import Section, Value, digits, finite
from hil.runs.experiment import plan

MS = 1e3
NOTE = (
    "γ: exact H∞ level over frequencies, whatever theorem found the gain, at the longest delay "
    "that the law knows of on this net (hinf_nodelay: none); none: the loop is not stable there, "
    "or the law has no level. Least γ: of any gain of this structure at that delay. Admits: the "
    "largest constant delay from sample to force at which the design model is stable; any: at "
    "every delay."
)


def design_numbers(paper: str, common: Mapping[str, Any], laws: Sequence[str], why: str) -> Section:
    """Return a row a law: gain, level and admitted delay, printed and recomputed.

    Args:
        paper: its key.
        common: keywords of the paper's runs.
        laws: names.
        why: what the printed gains are read as, and why they differ.
    """
    level = printed(paper).get("gamma_squared")
    rows: list[dict[str, Value]] = []
    for law in laws:
        row: dict[str, Value] = {"law": law}
        for gains in ("as_printed", "computed"):
            keywords = {**common, "law": law, "gains": gains}
            _, controller = plan("double_lane_change", **keywords)
            margins = controller.tables["margins"]
            most = finite(MS * margins["max_delay_s"])
            row |= {
                f"gain_{gains}": _gain(controller.tables["gains"]),
                f"gamma_{gains}": finite(margins.get("gamma", float("nan"))),
                f"admitted_delay_ms_{gains}": "any" if most is None else most,
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
    return Section(
        "design", "The gains behind the tables", columns, rows, f"{NOTE} {why}", upright=True
    )


def _gain(gains: Mapping[str, Any]) -> str:
    """Return roll-rate gain, or the gains on roll angle and rate, of u = −K x."""
    if "output_gain" in gains:
        return digits(-gains["output_gain"][0], 4)
    return ", ".join(digits(value, 4) for value in gains["feedback"][:2])
