"""``canroll.toml``: options that each command in a folder takes as if they were written there."""

import os
import re
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from shlex import join
from typing import Any

from canroll import documents
from canroll.errors import CanrollError, UnknownNameError, reading
from canroll.plant_sim.bodies import BODIES
from canroll.registry import TRUST
from canroll.setup.choices import CHOICES, PROJECT_FILE
from canroll.setup.words import arguments

FILE = "canroll.toml"
FMU = re.compile(r"(?i)\.fmu(#|$)")
BY_KEY = {choice.word: choice for choice in CHOICES.values()}


def words(options: Collection[str], given: Sequence[str]) -> list[str]:
    """Return what the file adds to a command line, and say so on stderr.

    An option that is given, or that a given calibration fixes, is not taken from the file.

    Args:
        options: the options of the command.
        given: the words of the command line.

    Raises:
        CanrollError: the file cannot be read, or has an invalid key or value.
    """
    path = Path(os.environ.get(PROJECT_FILE, FILE))
    if not path.name or not path.is_file():
        return []
    written = {word.partition("=")[0] for word in given}
    values = _read(path)
    fixed = CHOICES["calibration"].option in written or "calibration" in values
    taken = {
        name: value
        for name, value in values.items()
        if (option := CHOICES[name].option) in options
        and option not in written
        and not (fixed and CHOICES[name].frozen_in_calibration)
    }
    added = arguments(taken)
    if added:
        print(f"{path}: {join(added)}", file=sys.stderr)
    return added


def _read(path: Path) -> dict[str, Any]:
    """Return the choices of the file by name."""
    with reading(path):
        table: Mapping[str, Any] = documents.toml(path)
    values: dict[str, Any] = {}
    for key, value in table.items():
        if key not in BY_KEY:
            raise UnknownNameError(f"key of {path}:", key, BY_KEY)
        choice = BY_KEY[key]
        is_list = choice.repeated and isinstance(value, list)
        if choice.kind in (str, Path) and not (isinstance(value, str) or is_list):
            raise CanrollError(f"{path}: {key} = {value!r}: must be a text")
        choice.check_in_file(value, str(path))
        if choice.extensible is BODIES and FMU.search(value) and not TRUST.get():
            raise CanrollError(
                f"{path}: plant '{value}' is a program, which a file may not name: "
                "add --trust to execute it"
            )
        values[choice.name] = value
    return values
