"""Files of users: text bounded in size and depth, or read in a separate process."""

import io
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from canroll.errors import CanrollError, UnknownNameError, reason

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_BYTES = 16 << 20
"""Size of a text file; a larger one is not what it is taken for."""

MOST_PARTS = 32
"""Parts of a dotted key in TOML, whose reader takes a time that grows with their square."""
LONG_KEY = re.compile(
    rf"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){{{MOST_PARTS}}}"""
)
MOST_MEMORY = 16 << 30
"""Memory of a separate process that reads a file, bytes."""
MOST_SECONDS = 600.0
"""Time that it may take."""

KINDS = {
    "calibration": "a calibration, for --calibration",
    "tyre": "a vehicle, for --vehicle",
    "receive": "a map of signals, for --map",
}
"""What a TOML document with a table of that name is."""


def refuse_other(table: Mapping[str, Any], needed: str, where: str) -> None:
    """Refuse a document without the table ``needed`` if it is one of another kind.

    Raises:
        CanrollError: it is, and says of which.
    """
    for name, kind in KINDS.items():
        if needed not in table and name in table:
            raise CanrollError(f"{where}: this is {kind}")


def refuse_unknown(table: Iterable[str], known: Collection[str], kind: str) -> None:
    """Refuse a key that is not ``known``, with the one that was probably meant.

    Args:
        table: the keys given.
        known: those there are.
        kind: what a key is, with its place: "key in map.toml [xcp]".

    Raises:
        UnknownNameError: for the first such key.
    """
    for key in table:
        if key not in known:
            raise UnknownNameError(kind, key, known)


def text(path: Path) -> str:
    """Return the content of a UTF-8 file.

    Raises:
        OSError: it cannot be read.
        ValueError: it is not UTF-8, or larger than :data:`MOST_BYTES`.
    """
    with path.open("rb") as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ValueError(f"larger than {MOST_BYTES >> 20} MB")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8 (byte {error.start})") from error


def parse_toml(content: str) -> dict[str, Any]:
    """Return the table of a TOML document.

    Raises:
        ValueError: it is not TOML, nested too deeply, or has a key of too many parts.
    """
    if LONG_KEY.search(content):
        raise ValueError(f"a dotted key of more than {MOST_PARTS} parts")
    try:
        return tomllib.loads(content)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def toml(path: Path) -> dict[str, Any]:
    """Return the table of a TOML file.

    Raises:
        OSError: it cannot be read.
        ValueError: see :func:`text` and :func:`parse_toml`.
    """
    return parse_toml(text(path))


def parse_json(content: str) -> Any:  # noqa: ANN401 - whatever stands there
    """Return the value of a JSON document.

    Raises:
        ValueError: it is not JSON, or nested too deeply.
    """
    try:
        return json.loads(content)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def table(value: object, where: str) -> dict[str, Any]:
    """Return a value of a document, which must be a table.

    Raises:
        CanrollError: it is none; the message begins with ``where``.
    """
    if not isinstance(value, dict):
        raise CanrollError(f"{where} must be a table")
    return value


def read_apart(
    program: str, path: Path, *, memory: int = MOST_MEMORY, seconds: float = MOST_SECONDS
) -> "dict[str, NDArray[Any]]":
    """Return the arrays that a Python program makes of the file ``path``, by name.

    It runs in a separate process, which a reader in compiled code may end at a damaged file.

    Args:
        program: it finds the path in ``sys.argv[1]`` and writes an .npz to ``sys.stdout.buffer``.
        path: the file.
        memory: that it may have, bytes.
        seconds: that it may take.

    Raises:
        ValueError: the program failed; the message is the last line of its output, if any.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-c", f"{_LIMITED.format(memory)}{program}", str(path)],
            capture_output=True,
            check=False,
            timeout=seconds,
        )
    except subprocess.TimeoutExpired as error:
        raise ValueError(f"it cannot be read within {seconds:g} s") from error
    if done.returncode:
        errors = done.stderr.decode("utf-8", "replace").strip().splitlines()
        raise ValueError(errors[-1] if errors and done.returncode > 0 else "the reader crashed")
    import numpy as np  # noqa: PLC0415 - nothing else here needs it

    with np.load(io.BytesIO(done.stdout)) as stored:
        return dict(stored)


FIRST_BYTES = {
    b"MATLAB 7.3": "a MATLAB file of version 7.3 (HDF5)",
    b"MATLAB": "a MATLAB file",
    b"\x89HDF": "a file of version 7.3 (HDF5)",
    b"PK\x03\x04": "an Excel workbook, or another zip archive",
    b"\xd0\xcf\x11\xe0": "an Excel workbook",
    b"MDF ": "an MF4",
}
"""What a file is that begins with these bytes, whatever its suffix."""


def binary_kind(path: Path) -> str:
    """Return which of :data:`FIRST_BYTES` a file is, "" if none.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        first = file.read(16)
    return next((kind for start, kind in FIRST_BYTES.items() if first.startswith(start)), "")


_MAT_TO_NPZ = """
import math, sys, numpy, scipy.io
from scipy.io.matlab import MatlabFunction, MatlabOpaque

def limited(name, shape):
    if math.prod(shape) > MOST:
        raise ValueError(f"{name} has more than {MOST} numbers")

def take(name, value):
    if isinstance(value, (MatlabFunction, MatlabOpaque)) or not isinstance(value, numpy.ndarray):
        value = numpy.array("an object")
    limited(name, value.shape)
    if not value.dtype.hasobject:
        table[f"at {name}"] = value
        return
    for i, one in enumerate(value.ravel(order="F"), 1):
        if not value.dtype.names:
            take(f"{name}{{{i}}}", one)
        for field in value.dtype.names or ():
            take(f"{name}.{field}" if value.size == 1 else f"{name}({i}).{field}", one[field])

for name, shape, kind in scipy.io.whosmat(sys.argv[1]):
    limited(name, shape)
table = {}
for name, value in scipy.io.loadmat(sys.argv[1]).items():
    if not name.startswith("__"):
        take(name, value)
numpy.savez(sys.stdout.buffer, **table)
"""


def read_mat(
    path: Path, most: int, *, memory: int = MOST_MEMORY, seconds: float = MOST_SECONDS
) -> "dict[str, NDArray[Any]]":
    """Return the arrays of a .mat file of versions 4 to 7.2 by name, of ``most`` numbers each.

    Fields are named as in MATLAB: ``struct.field``, ``struct(2).field``, ``cell{2}``.

    Raises:
        OSError: it cannot be read.
        ValueError: scipy cannot read it, or an array is larger.
    """
    program = f"MOST = {most}\n{_MAT_TO_NPZ}"
    try:
        arrays = read_apart(program, path, memory=memory, seconds=seconds)
    except ValueError as error:
        why = f"not a .mat file that scipy can read: {reason(error)}"
        if "HDF" in binary_kind(path) + why:
            why = "of version 7.3 (HDF5): save it in MATLAB with -v7, or export CSV"
        raise ValueError(why) from error
    return {name.removeprefix("at "): array for name, array in arrays.items()}


_LIMITED = """
import resource
most, hard = {}, resource.getrlimit(resource.RLIMIT_AS)[1]
limit = most if hard == resource.RLIM_INFINITY else min(most, hard)
resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
"""


def with_short_lists(toml: str) -> str:
    """Return the text of a TOML file as written by tomli_w with lists of numbers on one line."""
    return _NUMBERS.sub(_one_line, toml)


_NUMBERS = re.compile(r"\[\n((?:\s*[-+.\w]+,\n)+)\s*\]")


def _one_line(match: re.Match[str]) -> str:
    """Put a list of plain numbers on one line."""
    return f"[{', '.join(match[1].replace(',', ' ').split())}]"
