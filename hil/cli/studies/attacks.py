"""``canroll attacks``: attackers on the bus, without authentication and with it."""

import argparse
import json
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from hil.attacks import suite
from hil.attacks.kinds import Attack
from hil.attacks.over_interface import EcuProcess, drive
from hil.attacks.suite import Drive, Driven, Outcome, Suite
from hil.cli import terminal
from hil.cli.cases import driven
from hil.cli.hil import bus_options, refuse_one_adapter
from hil.cli.options import choices_of
from hil.realtime.bus_link import has_bus, open_link
from hil.report.page import Table
from hil.report.run_folder import write_page
from hil.report.staging import page_folder
from hil.runs.result import Settings
from hil.setup.controller import Controller

BUSES = ("500k", "secured_fd")
"""The buses that are attacked where none is chosen: without authentication and with it."""
HEAD = (
    *("", "sent", "accepted", "refused", "roll max (deg)", "wrong side (N·m)", "for (s)"),
    "fault codes",
)


def run(args: argparse.Namespace) -> int:
    """Drive all attacks and print their tables; 1 if one gets through authentication."""
    out = page_folder(args.out)
    if has_bus(args):
        args.jobs = 1
    with driven(args, out) as cases, under(args) as drive:
        suites = [
            suite.run(args.scenario, named=args.attack, under=drive, cases=cases, **choices)
            for choices in chosen(choices_of(args))
        ]
    code = 1 if any(each.broken for each in suites) else 0
    data = write_page(out, "attacks", {}, {"suites": [each.to_json() for each in suites]})
    if args.json:
        print(json.dumps(data))
        return code
    for each in suites:
        terminal.show_verdict(each.verdict, good=not each.broken if each.authenticated else None)
        terminal.show_table(Table("", HEAD, list(rows(each))))
        print()
    return code


@contextmanager
def under(args: argparse.Namespace) -> Iterator[Drive | None]:
    """Yield what drives an attack: the interface of the options, or None for virtual time."""
    if not has_bus(args):
        yield None
        return
    options = bus_options(args)
    refuse_one_adapter(args)
    with tempfile.TemporaryDirectory(prefix="canroll-") as folder:
        yield partial(_on_interface, args, partial(EcuProcess, options, Path(folder)))


def _on_interface(
    args: argparse.Namespace,
    program: Callable[[Settings, Controller], EcuProcess],
    settings: Settings,
    controller: Controller,
    attack: Attack,
) -> Driven:
    link = open_link(args, settings.firmware.fd)
    attacker = open_link(args)
    ecu = program(settings, controller)
    try:
        return drive(settings, controller, attack, link=link, attacker=attacker.bus, ecu=ecu.start)
    finally:
        ecu.end()
        link.close()
        attacker.close()


def chosen(choices: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the choices of each suite: of the bus chosen, or of both by default."""
    if "bus" in choices or "dbc" in choices:
        return [choices]
    plain, secured = BUSES
    without_key = {name: value for name, value in choices.items() if name != "key"}
    return [{**without_key, "bus": plain}, {**choices, "bus": secured}]


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
