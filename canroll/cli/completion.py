"""``canroll completion``: a script with which a shell completes commands, options and names."""

import argparse
from collections.abc import Iterable
from typing import cast

import vehicles
from canroll.cli.commands import COMMANDS, parser_of
from canroll.cli.listing import REGISTRIES
from canroll.cli.main import TASKS
from canroll.cli.options import path_named
from canroll.errors import optional
from canroll.setup.choices import CHOICES


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    shtab = optional("shtab", "canroll completion", "completion")
    everything = argparse.ArgumentParser(prog="canroll")
    # only called, never subclassed
    commands = everything.add_subparsers(parser_class=cast(type[argparse.ArgumentParser], _parser))
    for name in (name for names in TASKS.values() for name in names):
        parser = commands.add_parser(name, help=COMMANDS[name].help)
        for action in parser._actions:
            _complete(action, shtab.FILE)
    print(shtab.complete(everything, args.shell))
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
