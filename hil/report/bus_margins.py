"""Output of ``canroll bus`` beyond the bounds: margins, missed deadlines, proposals."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from plant_sim.can_bus.analysis import ResponseBound
from plant_sim.can_bus.proposals import Proposal
from plant_sim.can_bus.sensitivity import Breakdown, ErrorTolerance

_MS = 1e-6
_TOLD = 5
"""The most probable misses that are printed; --json has all."""


@dataclass(frozen=True, slots=True)
class Margins:
    """Requested results beside the bounds, None where not requested.

    ``tolerance``: at ``errors_per_s``; ``proposal``: of ``what``, beside the bounds ``before``;
    ``refused``: why there is no proposal.
    """

    breakdown: Breakdown | None
    errors_per_s: float | None
    tolerance: Sequence[ErrorTolerance]
    what: str | None
    proposal: Proposal | None
    before: Sequence[ResponseBound]
    refused: str = ""


def margins_json(margins: Margins) -> dict[str, Any]:
    """Return the keys that the options add to the JSON object."""
    found: dict[str, Any] = {}
    if margins.breakdown is not None:
        found["breakdown"] = {
            "factor": margins.breakdown.factor,
            "utilisation": margins.breakdown.utilisation,
            "first": list(margins.breakdown.first),
        }
    if margins.errors_per_s is not None:
        found["errors"] = {
            t.message.name: {
                "deadline_ms": t.message.due_ns * _MS,
                "survived": t.errors,
                "miss_probability": t.probability,
            }
            for t in margins.tolerance
        }
    if margins.proposal is not None:
        found["proposal"] = {
            m.name: {
                "id": m.ident,
                "offset_ms": m.offset_ns * _MS,
                "bound_before_ms": _milliseconds(old.bound_ns),
                "bound_ms": _milliseconds(new.bound_ns),
            }
            for m, new, old in zip(
                margins.proposal.messages, margins.proposal.bounds, margins.before, strict=True
            )
        }
    if margins.refused:
        found["proposal"] = None
        found["no_proposal"] = margins.refused
    return found


def _milliseconds(value: int | None) -> float | None:
    return None if value is None else round(value * _MS, 6)


def show_margins(margins: Margins, console: Console) -> None:
    """Print the requested results."""
    found = margins.breakdown
    if found is not None and found.factor == 0.0:
        console.print(
            f"however seldom all messages come, {', '.join(found.first)} misses its deadline"
        )
    elif found is not None:
        falls = f"then {', '.join(found.first)} misses its deadline" if found.first else ""
        console.print(
            f"all messages may come {found.factor:.2f} times as often (load"
            f" {found.utilisation:.1%}), {falls}",
            highlight=False,
        )
    if margins.errors_per_s is not None:
        console.print(_error_line(margins), highlight=False)
    if margins.proposal is not None:
        console.print(_proposal_table(margins))
    if margins.refused:
        console.print(f"no {margins.what} proposed: {margins.refused}", highlight=False)


def _error_line(margins: Margins) -> str:
    worst = sorted(margins.tolerance, key=lambda t: -t.probability)[:_TOLD]
    told = ", ".join(
        f"{t.message.name} {t.probability:.2g}"
        + (f" (survives {t.errors})" if t.errors >= 0 else " (late without any)")
        for t in worst
    )
    return (
        f"at {margins.errors_per_s:g} errors a second a frame misses its deadline with a"
        f" probability of at most: {told}"
    )


def _proposal_table(margins: Margins) -> Table:
    assert margins.proposal is not None
    table = Table(
        title=f"proposed {margins.what}", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), title_style=""
    )
    table.add_column("message")
    for heading in ("id", "offset, ms", "deadline, ms", "bound, ms", "was, ms"):
        table.add_column(heading, justify="right")
    rows = zip(margins.proposal.messages, margins.proposal.bounds, margins.before, strict=True)
    for message, new, old in sorted(rows, key=lambda row: row[0].arbitration_key):
        limits = ["none" if b.bound_ns is None else f"{b.bound_ns * _MS:.3f}" for b in (new, old)]
        offset, due = message.offset_ns * _MS, message.due_ns * _MS
        table.add_row(message.name, f"{message.ident:X}", f"{offset:g}", f"{due:g}", *limits)
    return table
