"""The exception family: every user error, in one line with its remedy."""

import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile

EXTRAS = {
    "asammdf": ("asammdf",),
    "campaign": ("pyarrow",),
    "certify": ("python-flint",),
    "cluster": ("distributed",),
    "completion": ("shtab",),
    "fmi": ("fmpy",),
    "mcap": ("mcap",),
    "notebook": ("pandas", "xarray"),
    "target": ("bincopy", "capstone", "unicorn", "ziglang"),
    "uds": ("can-isotp", "udsoncan"),
    "xcp": ("pya2ldb", "pyxcp"),
}
"""Extras of this package, and the packages that come only with them."""

RENAMED = {
    "fullcar": "linear_car",
    "fullcar_hydraulic": "linear_car_hydraulic",
    "bias": "offset",
    "noise": "burst",
    "error_code": "invalid",
}
"""New names of choices that version 0.1 called otherwise."""

UNREADABLE = (
    *(OSError, ValueError, KeyError, IndexError, TypeError, AttributeError, EOFError),
    *(RuntimeError, BadZipFile, zlib.error, struct.error, SyntaxError, TokenError),
)
"""Exceptions raised by parsers of truncated, damaged or foreign files."""


def reason(error: BaseException) -> str:
    """Return why something failed: of an OSError without number and path, else the first line."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return (str(error).splitlines() or [type(error).__name__])[0]


class CanrollError(Exception):
    """What is wrong and what to do, in one line; the command line prints it and exits.

    ``exit_code`` is 2 where the input was wrong and 1 where a verdict failed.
    """

    exit_code = 2


class VerdictError(CanrollError):
    """The input was understood, and the answer is no: infeasible, unverified, over budget."""

    exit_code = 1


class UnknownNameError(CanrollError, KeyError):
    """A name that is not among the choices; the message suggests the nearest.

    Attributes:
        name: that name.
    """

    def __init__(
        self, what: str, name: str, choices: Iterable[str], *, near: Sequence[str] = ()
    ) -> None:
        name, known = str(name), sorted(filter(None, choices))  # of a file, it may be no text
        self.name = name
        near = near or [new for old, new in RENAMED.items() if old == name and new in known]
        near = near or get_close_matches(name, known, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"choose from {', '.join(known)}"
        super().__init__(f"unknown {what} '{name}': {hint}")

    __str__ = Exception.__str__  # a KeyError shows its argument quoted


class MissingExtraError(CanrollError):
    """An optional package is not installed; the message names the extra that brings it."""

    def __init__(self, what: str, extra: str) -> None:
        *others, last = EXTRAS[extra]
        packages = f"{', '.join(others)} and {last}" if others else last
        super().__init__(f"{what} needs {packages}: pip install 'canroll[{extra}]'")


@contextmanager
def writing(place: Path | str, remedy: str = "") -> Iterator[None]:
    """Say in one line what cannot be written, why, and what to do.

    Raises:
        CanrollError: the system refuses to write.
    """
    try:
        yield
    except OSError as error:
        hint = f": {remedy}" if remedy else ""
        raise CanrollError(f"cannot write {place}: {reason(error)}{hint}") from error


@contextmanager
def reading(place: Path | str) -> Iterator[None]:
    """Say in one line what cannot be read, and why.

    Raises:
        CanrollError: the file is missing, truncated, damaged or of another kind.
    """
    try:
        yield
    except CanrollError:
        raise
    except UNREADABLE as error:
        raise CanrollError(f"cannot read {place}: {reason(error)}") from error


def optional(module: str, what: str, extra: str) -> Any:  # noqa: ANN401
    """Import a module of a package that only ``extra`` brings; ``what`` needs it.

    Raises:
        MissingExtraError: the package is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise MissingExtraError(what, extra) from error
