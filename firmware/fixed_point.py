"""Fixed-point arithmetic that several stages share."""

from typing import Annotated

from canroll.firmware.calibration import N_STATES, Q_SHARE, STATE_MAX
from canroll.firmware.subset import absolute, clamp, i32, i64, sat31, scaled, tdiv


def magnitude(value: i32) -> i32:
    """Return the magnitude of ``value``, at most ``STATE_MAX``."""
    return clamp(absolute(value), 0, STATE_MAX)


def product(a: i32, b: i32, n: i32) -> i32:
    """Return ``a`` ``b`` / 2**n, rounded to nearest and limited to 31 bits."""
    return scaled(a * b, n)


def with_share(least: i32, value: i32, share: i32) -> i32:
    """Return ``least`` and a ``share`` of ``value``, rounded to nearest, limited to 31 bits."""
    return shifted(least * (1 << Q_SHARE) + value * share, Q_SHARE)


def shifted(v: i64, n: i32) -> i32:
    """Return ``v`` / 2**n, rounded to nearest and limited to 31 bits."""
    return scaled(v, n)


def quotient(a: i64, b: i32) -> i32:
    """Return ``a`` / ``b``, rounded towards zero and limited to 31 bits; ``b`` is not zero."""
    return sat31(tdiv(a, b))


def weighted(row: Annotated[list[i32], N_STATES], x: Annotated[list[i32], N_STATES]) -> i64:
    """Return the sum of products of a row of coefficients and a state."""
    return row[0] * x[0] + row[1] * x[1] + row[2] * x[2] + row[3] * x[3] + row[4] * x[4]
