"""``canroll attacks``: attackers on the bus, without authentication and with it."""

import argparse
import json
from collections.abc import Iterator
from typing import Any

from canroll.attacks import suite
from canroll.attacks.suite import AttackOutcome, Suite
from canroll.cli import terminal
from canroll.cli.cases import driven
from canroll.cli.options import choices_of
from canroll.report.page import PageTable
from canroll.report.run_folder import write_page
from canroll.report.staging import page_folder

BUSES = ("500k", "secured_fd")
"""The buses that are attacked where none is chosen: without authentication and with it."""
HEAD = (
    *("", "sent", "accepted", "refused", "roll max (deg)", "wrong side (N·m)", "for (s)"),
    "fault codes",
)


def run(args: argparse.Namespace) -> int:
    """Drive all attacks and print their tables; 1 if one gets through authentication."""
    out = page_folder(args.out)
    with driven(args, out) as cases:
        suites = [
            suite.run(args.scenario, named=args.attack, cases=cases, **choices)
            for choices in chosen(choices_of(args))
        ]
    code = 1 if any(each.broken for each in suites) else 0
    data = write_page(out, "attacks", {}, {"suites": [each.to_json() for each in suites]})
    if args.json:
        print(json.dumps(data))
        return code
    for each in suites:
        terminal.show_verdict(each.verdict, good=not each.broken if each.authenticated else None)
        terminal.show_table(PageTable("", HEAD, list(rows(each))))
        print()
    return code


def chosen(choices: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the choices of each suite: of the bus chosen, or of both by default."""
    if "bus" in choices or "dbc" in choices:
        return [choices]
    plain, secured = BUSES
    without_key = {name: value for name, value in choices.items() if name != "key"}
    return [{**without_key, "bus": plain}, {**choices, "bus": secured}]


def rows(suite: Suite) -> Iterator[tuple[str, ...]]:
    """Yield a row for each attack, and one for the vehicle without control."""
    yield from map(row, suite.outcomes)
    yield ("without control", "", "", "", f"{suite.passive_roll_deg:.2f}", "", "", "")


def row(outcome: AttackOutcome) -> tuple[str, ...]:
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
