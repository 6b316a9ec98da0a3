"""What a measurement adds to the motion: offsets of sensors, and delays between their stamps."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from canroll.errors import CanrollError, reading
from canroll.extensions.car.identification.drive_log import OUTPUTS, QUANTITIES, Log
from canroll.extensions.car.identification.pieces import Window
from canroll.extensions.car.identification.unknowns import (
    LOG,
    STEERING_OFFSET,
    delay_key,
    offset_key,
)


@dataclass(frozen=True, slots=True)
class Measurement:
    """Offsets (SI units) and delays behind the steering (s) of the signals of a log.

    ``steering_offset`` is that of the steering-wheel angle (rad). A signal without an entry has
    none. ``source`` says where they are from, "" without any.
    """

    steering_offset: float = 0.0
    offsets: Mapping[str, float] = field(default_factory=dict)
    delays: Mapping[str, float] = field(default_factory=dict)
    source: str = ""


NONE = Measurement()


def of_fit(path: Path) -> Measurement:
    """Return the offsets and delays that ``canroll fit`` has written to ``fit.json``.

    Raises:
        CanrollError: the file cannot be read, or is no result of a fit.
    """
    with reading(path):
        numbers: Any = json.loads(path.read_text())["numbers"]
        values = {str(number["key"]): float(number["value"]) for number in numbers}
    own = {key: value for key, value in values.items() if key.startswith(f"{LOG}.")}
    if not own or not all(isfinite(value) for value in own.values()):
        raise CanrollError(
            f"{path}: no offsets of a log: give the fit.json that 'canroll fit' wrote"
        )
    return Measurement(
        own.get(STEERING_OFFSET, 0.0),
        {name: own[offset_key(name)] for name in OUTPUTS if offset_key(name) in own},
        {name: own[delay_key(name)] for name in OUTPUTS if delay_key(name) in own},
        f"offsets and delays of {path}",
    )


def zeroed(log: Log, window: Window) -> Measurement:
    """Return as offsets the means of a log's signals while the car drives straight.

    Args:
        log: the measured drive.
        window: when it drives straight.

    Raises:
        CanrollError: a signal has no sample there.
    """
    means = {}
    for name in ("steering", *OUTPUTS):
        if name not in log.channels:
            continue
        channel = log.channels[name]
        inside = (channel.times >= window.begin) & (channel.times < window.end)
        if not inside.any():
            raise CanrollError(
                f"{log.name}: --zero: no {QUANTITIES[name].label} from {window.begin:g} to "
                f"{window.end:g} s"
            )
        means[name] = float(np.mean(channel.values[inside]))
    steering = means.pop("steering")
    return Measurement(
        steering, means, {}, f"offsets: means from {window.begin:g} to {window.end:g} s"
    )
