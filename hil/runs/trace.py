"""What a run leaves behind, as arrays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TICK = np.dtype(
    [
        ("t", "f8"),
        ("mode", "u1"),
        ("triggered", "u1"),
        ("troubles", "u4"),
        ("moment", "f8"),
        ("outputs", "f8", (2,)),
        ("roll", "f8"),
        ("roll_rate", "f8"),
        ("lateral_acceleration", "f8"),
        ("lateral_rate", "f8"),
        ("gyro_bias", "f8"),
    ]
)
"""What is kept of every tick, SI units: ``triggered`` 0 nothing, 1 trigger, 2 heartbeat; ``moment``
the anti-roll moment before trigger and split, ``outputs`` those of a law with two; the estimate."""


@dataclass(frozen=True, slots=True)
class Trace:
    """All that happened in one run.

    Attributes:
        signals: the vehicle every millisecond, one float64 array a signal, SI units; "time" in s.
        frames: the bus log, one entry a frame and segment, times in ns.
        ages: sample-to-force age of each newly applied command, ns.
        ticks: what the ECU did, one entry a tick (:data:`hil.runs.ecu.TICK`).
        duration: length of the run, s.
        complete: False where it was interrupted.
    """

    signals: dict[str, NDArray[np.float64]]
    frames: NDArray[np.void]
    ages: NDArray[np.int64]
    ticks: NDArray[np.void]
    duration: float
    complete: bool = True
