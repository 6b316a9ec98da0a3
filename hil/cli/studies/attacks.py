"""``canroll attacks``: attackers on the bus, without authentication and with it."""

import argparse
import json
from collections.abc import Iterator

from hil.attacks import suite
from hil.attacks.suite import Outcome, Suite
from hil.cli import terminal
from hil.cli.options import choices_of
from hil.report.page import Table

BUSES = ("500k", "secured_fd")
"""The buses that are attacked where none is chosen: without authentication and with it."""
HEAD = (
    *("", "sent", "accepted", "refused", "roll max (deg)", "wrong side (N·m)", "for (s)"),
    "fault codes",
)


def run(args: argparse.Namespace) -> int:
    """Drive all attacks and print their tables; 1 if one gets through authentication."""
    choices = choices_of(args)
    buses = (choices.pop("bus"),) if "bus" in choices else BUSES
    if len(buses) > 1 and "key" in choices:
        choices_of_key = {"key": choices.pop("key")}
    else:
        choices_of_key = {}
    found = []
    with terminal.progress(quiet=args.json) as progress:
        for bus in buses:
            key = choices_of_key if bus == BUSES[1] else {}
            found.append(suite.run(args.scenario, progress=progress, bus=bus, **choices, **key))
    code = 1 if any(its.broken for its in found) else 0
    if args.json:
        print(json.dumps({"suites": [its.to_json() for its in found]}))
        return code
    for its in found:
        terminal.show_verdict(its.verdict, good=not its.broken if its.authenticated else None)
        terminal.show_table(Table("", HEAD, list(rows(its))))
        print()
    return code


def rows(its: Suite) -> Iterator[tuple[str, ...]]:
    """Yield a row for each attack, and one for the vehicle without control."""
    yield from map(row, its.outcomes)
    yield ("without control", "", "", "", f"{its.passive_roll_deg:.2f}", "", "", "")


def row(outcome: Outcome) -> tuple[str, ...]:
    """What an attack did, as cells."""
    codes = ", ".join(outcome.codes)
    return (
        outcome.attack,
        str(outcome.sent),
        str(outcome.accepted),
        "" if outcome.refused is None else str(sum(outcome.refused)),
        f"{outcome.roll_max_deg:.2f}",
        f"{outcome.wrong_side_max_nm:.0f}",
        f"{outcome.wrong_side_s:.2f}",
        codes,
    )
