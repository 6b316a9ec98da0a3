"""The commands by name: each is the function that adds its options, and the module that runs it.

Nothing heavy is imported here: a command's module is imported after its options are parsed.
"""

from collections.abc import Callable, Mapping
from types import NoneType
from typing import TYPE_CHECKING, Any

from canroll.extension import guarded
from canroll.registry import Registry

if TYPE_CHECKING:
    from canroll.cli.parser import Parser


def accept(what: str, thing: Any) -> "Callable[[Parser], None]":  # noqa: ANN401
    """Return what adds the options of a package's command."""
    add_options: Callable[[Parser], None] = guarded(what, thing, 1, NoneType)
    return add_options


COMMANDS: "Registry[Callable[[Parser], None]]" = Registry(
    "command",
    "canroll.commands",
    {
        "run": "canroll.cli.run_parsers:run",
        "compare": "canroll.cli.run_parsers:compare",
        "design": "canroll.cli.design_parsers:design",
        "margins": "canroll.cli.design_parsers:margins",
        "prove": "canroll.cli.design_parsers:prove",
        "handling": "canroll.cli.run_parsers:handling",
        "bus": "canroll.cli.bus_parsers:bus",
        "hil": "canroll.cli.realtime_parsers:hil",
        "ecu": "canroll.cli.realtime_parsers:ecu",
        "plant": "canroll.cli.realtime_parsers:plant",
        "watch": "canroll.cli.realtime_parsers:watch",
        "export-c": "canroll.cli.design_parsers:export_c",
        "timing": "canroll.cli.design_parsers:timing",
        "list": "canroll.cli.listing:listing",
    },
    accept=f"{__name__}:accept",
)
"""What adds a command's options to its parser, by the command's name."""
TASKS: Mapping[str, tuple[str, ...]] = {
    "simulate": ("run", "compare"),
    "design": ("design", "margins", "prove"),
    "characterise a vehicle": ("handling",),
    "network": ("bus",),
    "hardware": ("hil", "ecu", "plant", "watch"),
    "export": ("export-c", "timing"),
    "names": ("list",),
}
"""The commands by what they are for."""

RENAMED: Mapping[str, str] = {
    "attacks": "faults --catalogue attacks",
    "completion": "list completion --shell SHELL",
    "design --runs": "compare --runs N",
    "limit": "handling limit SCENARIO",
    "report": "run FOLDER",
    "response": "handling response",
    "severe": "compare --scenario severe --runs N",
    "sweep": "compare --speed FROM:TO:STEP",
    "understeer": "handling circle",
}
"""How commands are written now that version 0.1 called otherwise."""


def grouped() -> Mapping[str, list[str]]:
    """Return the commands by what they are for, then those of each extension or package."""
    groups = {task: list(names) for task, names in TASKS.items()}
    told = {name for names in TASKS.values() for name in names}
    for name in (name for name in COMMANDS if name not in told):
        groups.setdefault(_extension(name), []).append(name)
    return groups


def _extension(name: str) -> str:
    """Return the name of the extension or package that a command comes from."""
    origin = COMMANDS.origin(name)
    within = origin.where.partition("canroll.extensions.")[2]
    return within.partition(".")[0] or origin.who


def parser_of(name: str) -> "Parser":
    """Return the parser of a command, which knows its handler."""
    # the table of choices, which the list of commands does without
    from canroll.cli.parser import Parser  # noqa: PLC0415

    add_options = COMMANDS[name]
    room = add_options.__module__.rpartition(".")[0]
    module = name.replace("-", "_")
    handler = f"{room}.{module}:run" if room else f"{module}:run"
    parser = Parser(prog=f"canroll {name}", handler=handler)
    add_options(parser)
    return parser
