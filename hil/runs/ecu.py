"""What is kept of an ECU's ticks, and who may run it."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.run.backends import BACKENDS, Backend, default_backend, open_backend
from codegen.run.memory_image import dtype
from firmware import calibration as formats
from firmware.state import GYRO_BIAS, LATERAL, LATERAL_RATE, ROLL, ROLL_RATE, Ecu
from hil.runs.trace import TICK

__all__ = [
    "BACKENDS",
    "Backend",
    "default_backend",
    "open_ecu",
    "record_tick",
    "tick_rows",
]

open_ecu = open_backend


def record_tick(row: np.void, t: float, state: Ecu) -> None:
    """Fill an entry of :data:`hil.runs.trace.TICK` from the state after a tick at ``t`` seconds."""
    _fill(row, t, lambda name: getattr(state, name))


def tick_rows(times: Sequence[float], images: Sequence[bytes]) -> NDArray[np.void]:
    """Return rows of :data:`hil.runs.trace.TICK` from the records after ticks at ``times`` (s)."""
    states = np.frombuffer(b"".join(images), dtype(Ecu))
    rows = np.zeros(len(states), TICK)
    _fill(rows, times, lambda name: np.moveaxis(states[name], 0, -1))
    return rows


def _fill(rows: Any, t: Any, field: Callable[[str], Any]) -> None:  # noqa: ANN401
    """Fill one entry or many: ``field`` gives a field of the record, ticks on the last axis."""
    state = field("x")
    rows["t"] = t
    rows["mode"] = field("mode")
    rows["triggered"] = field("triggered")
    rows["troubles"] = field("trouble_active")
    rows["moment"] = np.divide(field("moment"), 2**formats.Q_MOMENT)
    rows["outputs"] = np.transpose(np.divide(field("outputs"), 2**formats.Q_MOMENT))
    rows["roll"] = np.divide(state[ROLL], 2**formats.Q_ANGLE)
    rows["roll_rate"] = np.divide(state[ROLL_RATE], 2**formats.Q_RATE)
    rows["lateral_acceleration"] = np.divide(state[LATERAL], 2**formats.Q_ACCELERATION)
    rows["lateral_rate"] = np.divide(state[LATERAL_RATE], 2**formats.Q_ACCELERATION)
    rows["gyro_bias"] = np.divide(state[GYRO_BIAS], 2**formats.Q_RATE)
