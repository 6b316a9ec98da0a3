"""``canroll list``: names with their origin, and the script by which a shell completes them."""

import argparse
import json
from collections.abc import Iterable, Iterator
from typing import Any, cast

from canroll import vehicles
from canroll.cli.commands import COMMANDS, parser_of
from canroll.cli.options import JSON, path_named
from canroll.cli.parser import Parser, opt, related
from canroll.errors import optional
from canroll.gain_gen.laws import LAWS
from canroll.plant_sim.bodies import BODIES
from canroll.plant_sim.buses import BUSES
from canroll.plant_sim.driving import MANEUVERS
from canroll.registry import BUILT_IN, Registry
from canroll.setup.choices import CHOICES

KINDS = ("laws", "vehicles", "scenarios", "options", "buses", "bodies")
COMPLETION = "completion"
REGISTRIES: dict[str, Registry[Any]] = {
    "laws": LAWS,
    "scenarios": MANEUVERS,
    "buses": BUSES,
    "bodies": BODIES,
}
"""Further lists of ``canroll list``."""


def listing(parser: Parser) -> None:
    """Laws, vehicles, scenarios and their options, buses and bodies by name."""
    parser.handler = "canroll.cli.listing:run"
    parser.take(
        "List all names of a kind: built in, or from an installed package's entry points. "
        "Laws, scenarios, buses and bodies can also be named as file.py:name or module:name. Of "
        "completion: print the script by which a shell completes commands, options and names: "
        "source <(canroll list completion --shell bash)",
        opt("kind", (*KINDS, COMPLETION), "KIND", f"{', '.join(KINDS)}, or {COMPLETION}"),
        opt("--shell", ("bash", "zsh", "tcsh"), None, "of completion (default: %(default)s)",
            "bash", needs=(f"kind={COMPLETION}",), why=f"canroll list {COMPLETION}"),
        JSON,
        related("json", excludes={f"kind={COMPLETION}": "a script is no list"}),
    )  # fmt: skip


def entries(kind: str) -> list[dict[str, str]]:
    """Return name, origin and one-line description of all objects of a kind.

    Nothing is imported, so that an extension that cannot be imported is listed as well; only the
    options of the manoeuvres are read from them.
    """
    if kind == "options":
        return list(_options())
    if kind not in REGISTRIES:
        return [
            {"name": name, "origin": BUILT_IN, "description": vehicles.load(name).title}
            for name in vehicles.names()
        ]
    known = REGISTRIES[kind]
    return [
        {
            "name": name,
            "origin": known.origin(name).who,
            "description": known.description(name).removesuffix("."),
        }
        for name in known
    ]


def _options() -> Iterator[dict[str, str]]:
    from canroll.plant_sim.driving import maneuvers  # noqa: PLC0415 - numpy, which only this needs

    for scenario in MANEUVERS:
        for key, default in maneuvers.options(scenario).items():
            yield {
                "name": f"{scenario} {key}",
                "origin": MANEUVERS.origin(scenario).who,
                "description": maneuvers.describe(key, default),
            }


def run(args: argparse.Namespace) -> int:
    """Print the names of a kind, one per line, or one JSON array; or the script of a shell."""
    if args.kind == COMPLETION:
        return complete(args.shell)
    rows = entries(args.kind)
    # the console of tables takes as long to import as all else here
    if args.json:
        print(json.dumps(rows, ensure_ascii=False))
        return 0
    widths = [max(len(row[key]) for row in rows) for key in ("name", "origin")]
    for row in rows:
        name, origin = f"{row['name']:<{widths[0]}}", f"{row['origin']:<{widths[1]}}"
        print(f"{name}  {origin}  {row['description']}".rstrip())
    return 0


def complete(shell: str) -> int:
    """Print a script with which a shell completes commands, options and names."""
    shtab = optional("shtab", "canroll list completion", "completion")
    everything = argparse.ArgumentParser(prog="canroll")
    # only called, never subclassed
    commands = everything.add_subparsers(parser_class=cast(type[argparse.ArgumentParser], _parser))
    for name in COMMANDS:
        parser = commands.add_parser(name, help=COMMANDS.description(name))
        for action in parser._actions:
            _complete(action, shtab.FILE)
    print(shtab.complete(everything, shell))
    return 0


def _parser(*, prog: str) -> argparse.ArgumentParser:
    return parser_of(prog.rsplit(maxsplit=1)[-1])


def _complete(action: argparse.Action, files: object) -> None:
    """Name what can follow an option: the names of its registry, or a file."""
    known: Iterable[str] = CHOICES[action.dest].values() if action.dest in CHOICES else ()
    if action.dest == "scenario":
        known = REGISTRIES["scenarios"]
    elif action.dest in ("vehicle", "plant_vehicle"):
        known = vehicles.names()
    if names := sorted(known):
        action.choices = action.choices or names
    elif action.type is path_named:
        action.complete = files  # type: ignore[attr-defined]
