"""Fixed-point rows: the largest shift that a row of coefficients and its 64-bit sum allow."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil

import numpy as np

from canroll.errors import CanrollError
from canroll.firmware.calibration import (
    COEFFICIENT,
    Q_ACCELERATION,
    Q_ANGLE,
    Q_RATE,
    Q_SHARE,
    SHARE_MAX,
    STATE_MAX,
)
from canroll.gain_gen.models.roll import Matrix

Q_STATE = (Q_ANGLE, Q_RATE, Q_ACCELERATION, Q_ACCELERATION, Q_RATE)
"""Fractional bits of the observer's states."""
Q_MEASURED = (Q_RATE, Q_ACCELERATION, Q_ANGLE)
"""Fractional bits of the measurements: roll rate, lateral acceleration, roll angle."""
Q_COMPENSATOR = 24
Q_COMPENSATOR_INPUTS = (Q_ANGLE, Q_RATE, Q_ACCELERATION, Q_ACCELERATION)

MAX_SHIFT = 60
MAX_SUM = 1 << 62


@dataclass(frozen=True, slots=True)
class QuantisedRow:
    """One quantised row: stored integers, their common shift, the Q format of each coefficient.

    Attributes:
        stored: integers, |n| ≤ 2²⁹.
        shift: n of ``rsh(sum, n)``.
        formats: fractional bits of each coefficient as a physical value.
        error: largest absolute rounding error of a coefficient, in its physical unit.
    """

    stored: tuple[int, ...]
    shift: int
    formats: tuple[int, ...]
    error: float


def quantise_row(
    values: Matrix, factors: tuple[int, ...], result: int, *, name: str, bound: int = STATE_MAX
) -> QuantisedRow:
    """Return ``values`` as integers with the finest common shift.

    Args:
        values: coefficients, (n,).
        factors: fractional bits of each coefficient's factor.
        result: fractional bits of the row's result.
        name: for the error message.
        bound: largest magnitude of each factor as an integer.

    Raises:
        CanrollError: no shift keeps the coefficients in 30 bits and the sum in 62.
    """
    scale = np.array([2.0 ** (result - factor) for factor in factors]) * np.asarray(values, float)
    if not np.all(np.isfinite(scale)):
        raise CanrollError(f"{name}: a coefficient is not a number")
    if not np.any(scale):
        return QuantisedRow((0,) * len(factors), 1, tuple(1 + result - f for f in factors), 0.0)
    for shift in range(MAX_SHIFT, 0, -1):
        if np.abs(scale).max() * 2.0**shift > COEFFICIENT:
            continue
        stored = [round(float(value) * 2.0**shift) for value in scale]
        if sum(abs(value) for value in stored) * bound + (1 << shift) < MAX_SUM:
            formats = tuple(shift + result - factor for factor in factors)
            error = max(
                abs(value - stored_value * 2.0**-q)
                for value, stored_value, q in zip(values, stored, formats, strict=True)
            )
            return QuantisedRow(tuple(stored), shift, formats, float(error))
    raise CanrollError(
        f"{name}: a coefficient of {np.abs(values).max():.4g} exceeds the fixed-point row"
    )


def quantise(value: float, q: int, lo: int, hi: int, *, name: str) -> int:
    """Return ``value`` with ``q`` fractional bits.

    Raises:
        CanrollError: outside the field's range.
    """
    stored = round(value * 2.0**q)
    if not lo <= stored <= hi:
        raise CanrollError(
            f"{name}: {value:.6g} is outside {lo * 2.0**-q:.6g} to {hi * 2.0**-q:.6g}"
        )
    return stored


def shares(values: Iterable[float], name: str) -> list[int]:
    """Return shares in their format, rounded up.

    Raises:
        CanrollError: outside the field's range.
    """
    unit = 2.0**Q_SHARE
    return [
        quantise(ceil(value * unit) / unit, Q_SHARE, 0, SHARE_MAX, name=name) for value in values
    ]
