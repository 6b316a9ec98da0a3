"""When a fault acts, and how strongly: plain rows that every kernel can read."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.plant_sim.kernels.instants import NEVER
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.records import fields

FAULT = np.dtype(
    [*fields("i8", "places kind start end ramp every lasting"), *fields("f8", "value")]
)
"""A row: what fails, bit by bit (0: no fault, nor any after it), how, when (ns) and how much.

``every`` 0: without interruption.
"""
Faults: TypeAlias = NDArray[Any]
"""Rows of :data:`FAULT`."""


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
def severity(row: Any, t_ns: int) -> float:  # noqa: ANN401
    """Strength of a fault at ``t_ns``: 0 where it does not act, else up to 1."""
    since = t_ns - row.start
    if since < 0 or t_ns >= row.end:
        return 0.0
    if row.every > 0 and since % row.every >= row.lasting:
        return 0.0
    if since < row.ramp:
        return float(since / row.ramp)
    return 1.0


@njit
def _strength(row: Any, kind: int, places: int, t_ns: int) -> float:  # noqa: ANN401
    """Strength of a fault if it is of ``kind`` at one of ``places``, else 0."""
    return severity(row, t_ns) if row.kind == kind and row.places & places else 0.0


@njit
def most(faults: Faults, kind: int, places: int, t_ns: int) -> float:
    """Largest value, by its strength, of the faults of ``kind`` at ``places``; 0 without any."""
    value = 0.0
    for number in range(len(faults)):
        if faults[number].places == 0:
            break
        strength = _strength(faults[number], kind, places, t_ns)
        value = max(value, strength * faults[number].value)
    return value


@njit
def total(faults: Faults, kind: int, places: int, t_ns: int) -> float:
    """Sum of the values of these faults, each times its strength; 0 without any."""
    value = 0.0
    for number in range(len(faults)):
        if faults[number].places == 0:
            break
        value += _strength(faults[number], kind, places, t_ns) * faults[number].value
    return value


@njit
def factor(faults: Faults, kind: int, places: int, t_ns: int) -> float:
    """Product of the values of these faults, each as far from 1 as it is strong; 1 without any."""
    value = 1.0
    for number in range(len(faults)):
        if faults[number].places == 0:
            break
        strength = _strength(faults[number], kind, places, t_ns)
        value *= 1.0 + strength * (faults[number].value - 1.0)
    return value


def table(room: int, faults: Collection[Any], what: str) -> Faults:
    """Return rows of :func:`row`, and ``room`` in all; ``what`` and the room begin the refusal.

    Raises:
        CanrollError: more faults than there is room for.
    """
    if len(faults) > room:
        raise CanrollError(f"{what.format(room)} per run")
    return np.array([*faults, *[(0,) * len(FAULT.names or ())] * (room - len(faults))], FAULT)


def row(
    places: int, kind: int, fault: ScheduledFault, what: str, value: float = 1.0
) -> tuple[float, ...]:
    """Return the row of a fault with numbers for places, kind and value; ``what`` names it.

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
    return places, kind, start, end, ramp, every, lasting, value
