"""The ``canroll`` command: finds the subcommand's module, runs it, reports errors in one line."""

import argparse
import codecs
import errno
import io
import os
import sys
import tempfile
import traceback
from collections.abc import Sequence
from pkgutil import resolve_name

from canroll.cli.commands import COMMANDS, RENAMED, grouped, parser_of
from canroll.errors import EXTRAS, CanrollError, MissingExtraError, UnknownNameError, reason
from canroll.runs import mdf

PLAIN = {
    **{"°": " deg", "−": "-", "–": "-", "—": "-", "±": "+-", "·": ".", "×": "x", "…": "..."},
    **{"²": "2", "³": "3", "µ": "u", "≥": ">=", "≤": "<=", "φ": "phi", "χ": "chi", "→": "->"},
}
"""What is printed where the terminal's encoding lacks a character."""
INTERNAL_ERROR = 3
OF_THE_MACHINE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EMFILE, errno.ENOMEM)
"""Errors of the system that neither the input nor canroll is to blame for."""


def help_text() -> str:
    """Return what ``canroll --help`` prints."""
    width = max(len(name) for name in COMMANDS)
    lines: list[str] = []
    for task, names in grouped().items():
        lines += ["", f"{task}:"]
        lines += [f"  {name:<{width}}  {COMMANDS.description(name)[:-1]}" for name in names]
    return "\n".join(
        [
            "usage: canroll COMMAND [OPTIONS]",
            "",
            "From a roll-stability control law to code on an ECU with CAN.",
            *lines,
            "",
            "'canroll COMMAND --help' shows the options; 'canroll --version' the version.",
            "exit codes: 0 success, 1 failed verdict, 2 wrong input, 3 internal error, "
            "130 interrupted",
        ]
    )


def _version() -> str:
    from importlib.metadata import version  # noqa: PLC0415 - reads e-mail headers

    return version("canroll")


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the parsed arguments of one subcommand; ``arguments[0]`` is its name.

    They are in the result as ``arguments``, too.

    Raises:
        UnknownNameError: there is no such command.
        UsageError: its options are wrong.
        CanrollError: an option would have no effect.
    """
    # the table of choices, which --help does without
    from canroll.cli import project_file  # noqa: PLC0415
    from canroll.cli.parser import UsageError  # noqa: PLC0415

    name = arguments[0]
    if name.startswith("-"):
        raise UsageError(f"unknown option '{name}' (see 'canroll --help')")
    if name not in list(COMMANDS):  # nor a reference to code, which a registry takes
        if name in RENAMED:
            raise UsageError(f"'{name}' is now 'canroll {RENAMED[name]}'")
        raise UnknownNameError("command", name, COMMANDS)
    parser = parser_of(name)
    words = arguments[1:]
    added = project_file.words(parser.open_to(words), words)
    namespace, unknown = parser.read(words, added)
    if unknown and (old := f"{name} {unknown[0]}") in RENAMED:
        raise UsageError(f"'{old}' is now 'canroll {RENAMED[old]}'")
    if unknown:
        raise UsageError(
            f"'{name}' does not take {' '.join(unknown)} (see 'canroll {name} --help')"
        )
    namespace.arguments = [name, *added, *words]
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
        print(f"canroll {_version()}")
        return 0
    mdf.put_off()
    # as the table of choices in parse
    from canroll.registry import TRUST  # noqa: PLC0415

    # here and not in parse, which reads the command lines in files too
    TRUST.set("--trust" in arguments)
    namespace = parse(arguments)
    code: int = resolve_name(namespace.parser.handler)(namespace)
    sys.stdout.flush()
    return code


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``canroll`` with ``arguments`` (default: those of the process); return the exit code."""
    # Designs are many operations on small matrices: threads only wait for each other there, and
    # their number must not decide how a sum is rounded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    prepare_streams()
    try:
        return dispatch(sys.argv[1:] if arguments is None else arguments)
    except CanrollError as error:
        print(f"canroll: {error}", file=sys.stderr)
        return error.exit_code
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        for extra, packages in EXTRAS.items():
            if missing in packages:
                print(f"canroll: {MissingExtraError('this', extra)}", file=sys.stderr)
                return 2
        return internal_error(error)
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            # the interpreter flushes stdout once more at exit; that must not fail again
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        if error.errno not in OF_THE_MACHINE:
            return internal_error(error)
        place = f": {error.filename}" if error.filename else ""
        print(f"canroll: {reason(error)}{place}", file=sys.stderr)
        return 2
    except MemoryError:
        print("canroll: out of memory", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stopped:
        print(f"canroll: {str(stopped) or 'interrupted'}", file=sys.stderr)
        return 130
    except Exception as error:
        return internal_error(error)


def prepare_streams() -> None:
    """Replace closed streams, and characters that the terminal's encoding lacks."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            # a file opened later must not get the number of a standard stream
            stream = open(os.devnull, "w" if number else "r", encoding="utf-8")  # noqa: SIM115
            setattr(sys, name, stream)
    codecs.register_error("canroll-plain", plain)
    for output in (sys.stdout, sys.stderr):
        if isinstance(output, io.TextIOWrapper):
            output.reconfigure(errors="canroll-plain")


def plain(error: UnicodeError) -> tuple[str, int]:
    """Return ASCII text for characters that cannot be encoded, and where to go on."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(PLAIN.get(character, "?") for character in text), error.end


def internal_error(error: Exception) -> int:
    """Save the traceback to a file and name it; return the exit code of internal errors."""
    lines = "".join(traceback.format_exception(error))
    reason = f"{type(error).__name__}: {error}".partition("\n")[0]
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="canroll-error-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            file.write(f"canroll {_version()}\n{' '.join(sys.argv[1:])}\n{lines}")
        kept = f"please report it with {file.name}"
    except OSError:
        kept = f"please report it\n{lines}"
    print(f"canroll: internal error, {reason}: {kept}", file=sys.stderr)
    return INTERNAL_ERROR


if __name__ == "__main__":
    sys.exit(main())
