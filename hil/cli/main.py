"""The ``canroll`` command: finds the subcommand's module, runs it, turns errors into one line."""

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from typing import NoReturn

from canroll.errors import CanrollError, UnknownNameError

COMMANDS = {
    "run": "run a manoeuvre in virtual time, with and without control",
    "compare": "hold several runs or laws against each other on one page",
    "report": "judge a saved run again and write its page",
    "sweep": "run over a range of speeds or over several laws",
    "limit": "highest speed at which a manoeuvre is still passed",
    "understeer": "understeer and roll gradient on a circle (ISO 4138)",
    "response": "yaw and roll frequency response to steering (ISO 7401)",
    "design": "design a controller and freeze it into a calibration",
    "margins": "check a calibration by means independent of its design",
    "bus": "bus load, response times and a bus server",
    "hil": "run ECU and plant as two processes in real time",
    "ecu": "the ECU alone, on any python-can interface",
    "plant": "the vehicle alone, on any python-can interface",
    "watch": "watch the roll controller from the bus",
    "export-c": "export the controller as C99 with test vectors",
    "timing": "instructions, stack and sizes on the target; budget verdict",
    "prove": "prove the loop free of overflow for every accepted calibration",
    "reproduce": "recompute the tables of the four papers",
    "campaign": "Monte Carlo over parameters, noise, delays and faults",
}
"""Every subcommand and its line of help; the code is in ``hil.cli``, loaded when asked for."""


EXTRAS = {
    "target": ("elftools", "unicorn", "ziglang"),
    "asammdf": ("asammdf",),
    "web": ("websockets",),
}
"""Extras of this package, and the packages that come only with them."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line that says where help is."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong in one line on stderr and exit with 2."""
        raise UsageError(f"{message} (see '{self.prog} --help')")


class UsageError(CanrollError):
    """The command line could not be understood."""


def module_name(command: str) -> str:
    """Return the module that implements ``command``."""
    return f"hil.cli.{command.replace('-', '_')}"


def available() -> dict[str, str]:
    """Return the commands whose module is installed, with their line of help."""
    return {name: text for name, text in COMMANDS.items() if find_spec(module_name(name))}


def help_text() -> str:
    """Return what ``canroll --help`` prints."""
    commands = available()
    width = max(len(name) for name in commands)
    lines = [f"  {name:<{width}}  {text}" for name, text in commands.items()]
    return "\n".join(
        [
            "usage: canroll COMMAND [OPTIONS]",
            "",
            "From a roll-stability control law to code on an ECU that talks CAN.",
            "",
            "commands:",
            *lines,
            "",
            "'canroll COMMAND --help' tells a command's options; 'canroll --version' the version.",
            "exit codes: 0 good, 1 the verdict is no, 2 the input is wrong, 130 interrupted",
        ]
    )


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the parsed arguments of one subcommand; ``arguments[0]`` is its name.

    Raises:
        UnknownNameError: there is no such command.
        UsageError: its options are wrong.
    """
    command = arguments[0]
    if command.startswith("-"):
        raise UsageError(f"unknown option '{command}' (see 'canroll --help')")
    if command not in available():
        raise UnknownNameError("command", command, available())
    parser = Parser(prog="canroll")
    import_module(module_name(command)).add_parser(parser.add_subparsers(dest="command"))
    namespace, unknown = parser.parse_known_args(arguments)
    if unknown:
        told = f"see 'canroll {command} --help'"
        raise UsageError(f"'{command}' takes no {' '.join(unknown)} ({told})")
    return namespace


def dispatch(arguments: Sequence[str]) -> int:
    """Run one subcommand and return its exit code; errors are raised."""
    if not arguments:
        print(help_text())
        return 2
    if arguments[0] in ("-h", "--help"):
        print(help_text())
        return 0
    if arguments[0] == "--version":
        print(f"canroll {version('canroll')}")
        return 0
    namespace = parse(arguments)
    code: int = namespace.run(namespace)
    sys.stdout.flush()
    return code


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``canroll`` with ``arguments`` (the process's own by default); return the exit code."""
    # Designs are many operations on small matrices: threads only wait for each other there, and
    # their number must not decide how a sum is rounded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        return dispatch(sys.argv[1:] if arguments is None else arguments)
    except CanrollError as error:
        print(f"canroll: {error}", file=sys.stderr)
        return error.exit_code
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        for extra, packages in EXTRAS.items():
            if missing in packages:
                needs = f"needs {'/'.join(packages)}: .venv/bin/pip install -e '.[{extra}]'"
                print(f"canroll: this {needs}", file=sys.stderr)
                return 2
        raise
    except KeyboardInterrupt:
        print("canroll: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # the interpreter flushes stdout once more at exit; that must not fail again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


if __name__ == "__main__":
    sys.exit(main())
