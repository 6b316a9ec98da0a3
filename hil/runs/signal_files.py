"""The signals of a run as a file: CSV, or MF4 where asammdf is installed."""

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from hil.runs import signals_mf4

SUFFIXES = (".csv", ".mf4")


def check_suffix(path: Path) -> Path:
    """Return ``path`` if it names a format that can be written here.

    Raises:
        CanrollError: another suffix, or the package for it is missing.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise CanrollError(f"{path}: the suffix of signals is one of {', '.join(SUFFIXES)}")
    if path.suffix.lower() == ".mf4" and find_spec("asammdf") is None:
        raise CanrollError("signals as .mf4 needs asammdf: .venv/bin/pip install -e '.[asammdf]'")
    return path


def write_signals(path: str | Path, signals: Mapping[str, NDArray[np.float64]]) -> Path:
    """Write the signals of a trace, a row a millisecond, SI units, "time" first; return the path.

    Numbers in CSV have nine digits.

    Raises:
        CanrollError: another suffix than .csv or .mf4, or the file cannot be written.
    """
    path = check_suffix(Path(path))
    if path.suffix.lower() == ".mf4":
        signals_mf4.write(path, signals)
        return path
    columns = np.column_stack(list(signals.values()))
    try:
        np.savetxt(path, columns, fmt="%.9g", delimiter=",", header=",".join(signals), comments="")
    except OSError as error:
        raise CanrollError(f"cannot write {path}: {error.strerror or error}") from error
    return path
