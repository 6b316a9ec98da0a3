"""When a fault acts, and how strongly: plain rows of integers that every kernel can read."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from plant_sim.kernels.instants import NEVER
from plant_sim.kernels.jit import njit

# Columns of a row; times in ns. EVERY 0: without interruption.
TARGET, KIND, START, END, RAMP, EVERY, LASTING, N_SCHEDULE = range(8)
NO_TARGET = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class ScheduledFault:
    """One fault, as plain data.

    It acts from ``start`` until before ``end`` (s) and reaches its full strength after ``ramp``;
    with ``every`` above 0 it is intermittent: it acts for ``lasting`` in each such period.

    Attributes:
        where: what fails.
        kind: how.
        value: how much, in SI units; 0 where the kind has no value.
    """

    where: str
    kind: str
    value: float = 0.0
    start: float = 0.0
    end: float = math.inf
    ramp: float = 0.0
    every: float = 0.0
    lasting: float = 0.0


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


def row(target: int, kind: int, fault: ScheduledFault, what: str) -> list[int]:
    """Return the row of a fault with numbers for its place and kind; ``what`` names it in messages.

    Raises:
        CanrollError: times out of range.
    """
    if not 0 <= fault.start < fault.end:
        raise CanrollError(f"{what}: start must be >= 0 and before end")
    if not 0 <= fault.ramp < math.inf:
        raise CanrollError(f"{what}: ramp must be 0 or more")
    if fault.every and not 0 < fault.lasting < fault.every < math.inf:
        raise CanrollError(f"{what}: an intermittent fault lasts above 0 and below its period")
    end = round(fault.end * 1e9) if math.isfinite(fault.end) else NEVER
    times = (fault.start, fault.ramp, fault.every, fault.lasting)
    start, ramp, every, lasting = (round(value * 1e9) for value in times)
    return [target, kind, start, end, ramp, every, lasting]
