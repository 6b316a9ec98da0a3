"""When a fault acts, and how strongly: plain rows of integers that every kernel can read."""

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from plant_sim.kernels.jit import njit

# Columns of a row; times in ns. EVERY 0: without interruption.
TARGET, KIND, START, END, RAMP, EVERY, LASTING, N_SCHEDULE = range(8)
NEVER = 2**62
NO_TARGET = -1


class Timed(Protocol):
    """What all faults have in common, times in s.

    A fault acts from ``start`` until before ``end`` and reaches its full strength after ``ramp``;
    with ``every`` above 0 it acts for ``lasting`` at the beginning of each such period.
    """

    @property
    def start(self) -> float:
        """Beginning."""

    @property
    def end(self) -> float:
        """End; infinite: none."""

    @property
    def ramp(self) -> float:
        """Time from nothing to full strength."""

    @property
    def every(self) -> float:
        """Period of an intermittent fault; 0: without interruption."""

    @property
    def lasting(self) -> float:
        """Time for which an intermittent fault acts in each period."""


@njit
def severity(row: NDArray[np.int64], t_ns: int) -> float:
    """Strength of a fault at ``t_ns``: 0 where it does not act, else up to 1."""
    since = t_ns - row[START]
    if since < 0 or t_ns >= row[END]:
        return 0.0
    if row[EVERY] > 0 and since % row[EVERY] >= row[LASTING]:
        return 0.0
    if since < row[RAMP]:
        return float(since / row[RAMP])
    return 1.0


def table(rooms: int) -> NDArray[np.int64]:
    """Return ``rooms`` rows of no fault."""
    return np.full((rooms, N_SCHEDULE), NO_TARGET, dtype=np.int64)


def row(target: int, kind: int, timed: Timed, what: str) -> list[int]:
    """Return the row of a fault; ``what`` names it in messages.

    Raises:
        CanrollError: times that cannot be.
    """
    if not 0 <= timed.start < timed.end:
        raise CanrollError(f"{what}: start must be >= 0 and before end")
    if not 0 <= timed.ramp < math.inf:
        raise CanrollError(f"{what}: ramp must be 0 or more")
    if timed.every and not 0 < timed.lasting < timed.every < math.inf:
        raise CanrollError(f"{what}: an intermittent fault lasts above 0 and below its period")
    end = round(timed.end * 1e9) if math.isfinite(timed.end) else NEVER
    times = (timed.start, timed.ramp, timed.every, timed.lasting)
    start, ramp, every, lasting = (round(value * 1e9) for value in times)
    return [target, kind, start, end, ramp, every, lasting]
