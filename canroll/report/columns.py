"""Columns of recorded numbers, packed small enough that a page holds a whole run of them.

A column is whole multiples of a step above its smallest value. What changes slowly has second
differences of few bits; their bytes, the lowest of all values first, compress well. The inverse is
``recorded.js``.
"""

import base64
import zlib
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

STEPS = 1 << 18
"""Steps between the smallest and the largest value of a column: 4 millionths of its range each."""
NOT_A_NUMBER = -1
LEVEL = 6
TIME_STEPS = 1 << 31
"""More steps of time than this do not fit a column."""


def packed_bytes(values: NDArray[np.uint8]) -> str:
    """Return bytes compressed, as base64; the same bytes give the same text."""
    return base64.b64encode(zlib.compress(values.tobytes(), LEVEL)).decode("ascii")


def column(values: ArrayLike) -> dict[str, object]:
    """Return numbers in steps of 4 millionths of their range; what is not finite has no value."""
    numbers = np.asarray(values, dtype=float).ravel()
    known = np.isfinite(numbers)
    low, high = (np.min(numbers[known]), np.max(numbers[known])) if known.any() else (0.0, 0.0)
    # halves, as the range of a float's own limits is no float
    step = 2 * (high / 2 - low / 2) / STEPS
    if step == 0:
        return _packed(np.where(known, 0, NOT_A_NUMBER), float(low), 1.0)
    places = np.where(known, np.rint((np.where(known, numbers, low) - low) / step), NOT_A_NUMBER)
    return _packed(places, float(low), float(step))


def instants(seconds: ArrayLike) -> dict[str, object]:
    """Return times from 0 on, s, to the microsecond, or to the 0.1 ms in runs of over 30 min."""
    times = np.asarray(seconds, dtype=float)
    step = 1e-6 if not times.size or times[-1] / 1e-6 < TIME_STEPS else 1e-4
    return _packed(np.rint(times / step), 0.0, step)


def payloads(rows: NDArray[np.uint8]) -> str:
    """Return payloads, (frames, bytes), packed: each byte as its change since the frame before."""
    changes = np.diff(rows, axis=0, prepend=np.zeros((1, rows.shape[1]), np.uint8))
    return packed_bytes(np.ascontiguousarray(changes.T))


def _packed(places: NDArray[np.number], low: float, step: float) -> dict[str, object]:
    # differences wrap around as the page's sums do
    integers = places.astype(np.int64).astype(np.uint32)
    for _ in range(2):
        integers = np.diff(integers, prepend=np.uint32(0))
    # the sign goes last, so that the higher bytes of small numbers are 0
    integers = integers << np.uint32(1) ^ np.where(
        integers >> 31, np.uint32(0xFFFFFFFF), np.uint32(0)
    )
    planes = integers.astype("<u4").view(np.uint8).reshape(-1, 4).T
    return {
        "count": len(integers),
        "low": low,
        "step": step,
        "packed": packed_bytes(np.ascontiguousarray(planes)),
    }


def every(parts: Iterable[NDArray[np.float64]], stride: int) -> NDArray[np.float64]:
    """Return each ``stride``-th value of a signal that comes in parts."""
    kept, first = [np.zeros(0)], 0
    for part in parts:
        kept.append(part[-first % stride :: stride])
        first += len(part)
    return np.concatenate(kept)
