"""The answer of ``canroll hil --check`` on the terminal."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

from hil.realtime.timing import QUANTILES


def show(answer: Mapping[str, Any]) -> None:
    """Print a report of :func:`hil.realtime.check.measure.report`."""
    console = Console(highlight=False, soft_wrap=True)
    table = Table("µs", *QUANTILES, box=None, pad_edge=False, header_style="bold")
    for column in table.columns[1:]:
        column.justify = "right"
    rows = [
        (f"wake-up, {_place(loop)} ({loop['role']})", loop["late_us"]) for loop in answer["loops"]
    ]
    bus = answer["bus"]
    rows += [
        ("timer, beyond 50 µs", answer["timer"]["overshoot_us"]),
        ("tick of the firmware", answer["tick_us"]),
        (f"round trip, {bus['interface']}", bus["round_trip_us"]),
        (f"empty read, {bus['interface']}", bus["poll_us"]),
    ]
    for name, figures in rows:
        if figures is not None:
            table.add_row(name, *(f"{figures[quantile]:.0f}" for quantile in QUANTILES))
    console.print(table)
    if bus["missing"]:
        console.print(f"no round trip: {bus['missing']}")
    if bus["lost"]:
        console.print(f"{bus['lost']} frames did not come back")
    worst = max(answer["needed_us"].values())
    held = [f"{tick} ms {'yes' if ok else 'no'}" for tick, ok in answer["ticks"].items()]
    console.print(f"\nticks this machine can keep: {', '.join(held)}")
    colour, word = ("green", "can") if answer["held"] else ("red", "cannot")
    console.print(
        f"[{colour}]This machine {word} keep a tick of {answer['tick_ms']:g} ms:[/{colour}] "
        f"at worst {worst:.0f} µs of the {500 * answer['tick_ms']:.0f} µs allowed by the rule"
    )
    console.print(f"rule: {answer['rule']}")
    if answer["findings"]:
        console.print("\nfound, with remedies:")
    for found in answer["findings"]:
        console.print(f"  {found['what']}: {found['remedy']}", markup=False)


def _place(loop: Mapping[str, Any]) -> str:
    return "not pinned" if loop["core"] is None else f"core {loop['core']}"
