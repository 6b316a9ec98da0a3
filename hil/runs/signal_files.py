"""The signals of a run as a file: CSV, or MF4 if asammdf is installed."""

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, MissingExtraError
from plant_sim.world.spool import pieces

SUFFIXES = (".csv", ".mf4")
_UNITS = {
    "x": "m",
    "y": "m",
    "yaw": "rad",
    "vx": "m/s",
    "vy": "m/s",
    "ax": "m/s²",
    "ay": "m/s²",
    "roll": "rad",
    "pitch": "rad",
    "heave": "m",
    "path_error": "m",
    "steer": "rad",
    "bank": "rad",
}
_FAMILIES = {
    "wheel_load": "N",
    "travel_rate": "m/s",
    "travel": "m",
    "wheel_speed": "rad/s",
    "wheel_height": "m",
    "lateral_force": "N",
    "corner_force": "N",
    "bar_angle": "rad",
    "bar_pressure": "Pa",
    "bar_moment": "N·m",
    "moment": "N·m",
    "valve_current": "A",
}
_RATES = {"yaw": "rad", "roll": "rad", "pitch": "rad", "heave": "m"}


def check_suffix(path: Path) -> Path:
    """Return ``path`` if its suffix is that of a supported format.

    Raises:
        CanrollError: another suffix, or the package for it is missing.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise CanrollError(
            f"{path}: the suffix of a signal file must be one of {', '.join(SUFFIXES)}"
        )
    if path.suffix.lower() == ".mf4" and find_spec("asammdf") is None:
        raise MissingExtraError("--signals FILE.mf4", "asammdf")
    return path


def write_signals(path: str | Path, signals: Mapping[str, NDArray[np.float64]]) -> Path:
    """Write the signals of a trace, a row per millisecond, SI units, "time" first; return the path.

    Numbers in CSV have nine digits.

    Raises:
        CanrollError: another suffix than .csv or .mf4, or the file cannot be written.
    """
    path = check_suffix(Path(path))
    if path.suffix.lower() == ".mf4":
        _write_mf4(path, signals)
        return path
    try:
        with path.open("w", encoding="latin-1") as file:
            file.write(",".join(signals) + "\n")
            for columns in pieces(signals, *signals):
                np.savetxt(file, np.column_stack(columns), fmt="%.9g", delimiter=",")
    except OSError as error:
        raise CanrollError(f"cannot write {path}: {error.strerror or error}") from error
    return path


def unit(name: str) -> str:
    """Return the unit of a recorded signal, '' for flags and units that depend on the actuator."""
    if name in _UNITS:
        return _UNITS[name]
    stem, _, derivative = name.rpartition("_")
    if stem in _RATES and derivative in ("rate", "acc"):
        return _RATES[stem] + ("/s" if derivative == "rate" else "/s²")
    return next((u for family, u in _FAMILIES.items() if name.startswith(family)), "")


def _write_mf4(path: Path, signals: Mapping[str, NDArray[np.float64]]) -> None:
    """Write ``signals`` as ASAM MDF 4 with their units; "time" is the common axis, s."""
    from asammdf import MDF, Signal  # noqa: PLC0415 - an extra

    channels = [
        Signal(np.ascontiguousarray(values), signals["time"], name=name, unit=unit(name))
        for name, values in signals.items()
        if name != "time"
    ]
    try:
        with MDF(version="4.10") as file:
            file.append(channels, comment="canroll")
            file.save(path, overwrite=True)
    except OSError as error:
        raise CanrollError(f"cannot write {path}: {error.strerror or error}") from error
