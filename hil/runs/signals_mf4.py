"""Signals of a run as an ASAM MDF 4 file, written after the run."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError

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


def unit(name: str) -> str:
    """Return the unit of a recorded signal, '' for flags and what depends on the actuator."""
    if name in _UNITS:
        return _UNITS[name]
    stem, _, derivative = name.rpartition("_")
    if stem in _RATES and derivative in ("rate", "acc"):
        return _RATES[stem] + ("/s" if derivative == "rate" else "/s²")
    return next((u for family, u in _FAMILIES.items() if name.startswith(family)), "")


def write(path: Path, signals: Mapping[str, NDArray[np.float64]]) -> None:
    """Write ``signals`` with their units; "time" is the common axis, s.

    Raises:
        CanrollError: the file cannot be written.
    """
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
