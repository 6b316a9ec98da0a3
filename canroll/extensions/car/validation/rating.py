"""The rating of ISO/TS 18571 of a simulated signal against a measured one.

The standard's windows count in samples, at 10 kHz for signals of a crash; those of a drive are a
hundred times as slow and sampled at 100 Hz.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from canroll.extensions.car.identification.log_checks import LEAST_ACCELERATION
from canroll.extensions.car.identification.pieces import SAMPLE
from canroll.extensions.car.validation.replayed import Drive, runs
from canroll.typing import Vector

GRADES = ((0.94, "excellent"), (0.80, "good"), (0.58, "fair"))
"""Ratings above which ISO/TS 18571 has these words; below it is poor."""
CORRIDORS = (0.05, 0.5)
"""Half width of the inner and outer corridor over the largest measured value."""
MOST_SHIFT = 0.2
"""Share of the samples that a signal is shifted by at most, which rates 0."""
WARPED = 0.1
"""Share of the samples that time is warped by at most."""
MOST_MAGNITUDE, MOST_SLOPE = 0.5, 2.0
"""Relative errors of magnitude and slope that rate 0."""
SMOOTHED = 9
"""Samples of a slope's mean."""
LONGEST = 10.0
"""A longer stretch (s) is rated in parts: the shift that a rating allows grows with its length."""
SHORTEST = 0.5
"""A shorter one (s) is not rated."""


@dataclass(frozen=True, slots=True)
class Rating:
    """Ratings from 0 to 1: overall, which is 0.4 corridor and 0.2 of each of the others."""

    overall: float
    corridor: float
    phase: float
    magnitude: float
    slope: float

    @property
    def grade(self) -> str:
        """The word of the standard."""
        return next((word for least, word in GRADES if self.overall > least), "poor")


def rate(measured: Vector, simulated: Vector, interval: float = SAMPLE) -> Rating:
    """Rate a simulated signal against a measured one, both (n,), every ``interval`` (s)."""
    shift, reference, shifted = _best_shift(measured, simulated)
    corridor = _corridor(measured, simulated)
    phase = _share_left(shift, MOST_SHIFT * len(measured))
    magnitude = _magnitude(reference, shifted)
    slope = _slope(reference, shifted, interval)
    overall = 0.4 * corridor + 0.2 * phase + 0.2 * magnitude + 0.2 * slope
    return Rating(overall, corridor, phase, magnitude, slope)


def _share_left(error: float, most: float) -> float:
    return float(max((most - error) / most, 0.0))


def _corridor(measured: Vector, simulated: Vector) -> float:
    """Mean over the samples: 1 in the inner corridor, 0 outside the outer one, between squared."""
    inner, outer = (share * np.abs(measured).max() for share in CORRIDORS)
    difference = np.abs(measured - simulated)
    inside = ((outer - difference) / (outer - inner)) ** 2
    inside[difference < inner] = 1.0
    inside[difference > outer] = 0.0
    return float(sum(inside) / len(inside))


def _best_shift(measured: Vector, simulated: Vector) -> tuple[int, Vector, Vector]:
    """Return the shift, in samples, of greatest correlation, and what is left of both behind it.

    Of equal ones the least, first the simulated signal to the left.
    """
    n = len(measured)
    pairs = [(0, measured, simulated)]
    for k in range(1, int(MOST_SHIFT * n) + 1):
        pairs += [(k, measured[:-k], simulated[k:]), (k, measured[k:], simulated[:-k])]
    best, greatest = pairs[0], np.corrcoef(measured, simulated)[0, 1]
    for pair in pairs[1:]:
        correlation = np.corrcoef(*pair[1:])[0, 1]
        if correlation > greatest:
            best, greatest = pair, correlation
    return best


def _magnitude(reference: Vector, shifted: Vector) -> float:
    """Of both signals where time is warped so that their squared difference is least."""
    i, j = _warping(shifted, reference, int(np.ceil(WARPED * len(reference))))
    error = np.abs(shifted[i] - reference[j]).sum() / np.abs(reference[j]).sum()
    return _share_left(error, MOST_MAGNITUDE)


def _warping(x: Vector, y: Vector, width: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the samples of x and y, both (n,), that meet, less than ``width`` apart.

    Dynamic programming along the diagonals from earlier to later samples.
    """
    n = len(x)
    total = np.full((n + 1, n + 1), np.inf)
    total[0, 0] = 0.0
    for d in range(2 * n - 1):
        first = max(0, d - n + 1, (d - width + 2) // 2)
        i = np.arange(first, min(n, d + 1, (d + width - 1) // 2 + 1))
        j = d - i
        before = np.minimum(total[i, j + 1], total[i + 1, j])
        total[i + 1, j + 1] = np.minimum(before, total[i, j]) + (x[i] - y[j]) ** 2
    a = b = n - 1
    path = [(a, b)]
    while a or b:
        step = int(np.argmin((total[a, b + 1], total[a + 1, b], total[a, b])))
        a, b = a - (step != 1), b - (step != 0)
        path.append((a, b))
    i, j = np.array(path[::-1]).T
    return i, j


def _slope(reference: Vector, shifted: Vector, interval: float) -> float:
    """Of the derivatives, each the mean of nine samples, towards the ends of as many as there."""
    of_reference, of_shifted = (
        _smoothed(np.gradient(values, interval)) for values in (reference, shifted)
    )
    error = np.abs(of_shifted - of_reference).sum() / np.abs(of_reference).sum()
    return _share_left(error, MOST_SLOPE)


def _smoothed(values: Vector) -> Vector:
    ends = range(1, SMOOTHED, 2)
    middle = np.convolve(values, np.ones(SMOOTHED) / SMOOTHED, mode="valid")
    left, right = ([1 / k * side[:k].sum() for k in ends] for side in (values, values[::-1]))
    return np.concatenate((left, middle, right[::-1]))


def rate_drive(drive: Drive, name: str) -> tuple[Rating | None, float]:
    """Return the mean rating of a signal, by duration, and the seconds that were rated.

    Parts of a drive without steering, in which a signal is the road and noise, are not rated.
    """
    total, weights = np.zeros(len(fields(Rating))), 0.0
    for stretch in drive.stretches:
        for run in runs(stretch.compared(name)):
            count = run.stop - run.start
            parts = max(-(-count // round(LONGEST / SAMPLE)), 1)
            for part in np.array_split(np.arange(run.start, run.stop), parts):
                if len(part) < SHORTEST / SAMPLE or not _steered(stretch.lateral[part]):
                    continue
                measured, simulated = stretch.measured[name][part], stretch.simulated[name][part]
                if not (np.ptp(measured) > 0.0 and np.ptp(simulated) > 0.0):
                    continue
                one = rate(measured, simulated)
                values = [getattr(one, field.name) for field in fields(one)]
                total += len(part) * np.array(values)
                weights += len(part)
    if not weights:
        return None, 0.0
    return Rating(*(total / weights).tolist()), weights * SAMPLE


def _steered(lateral: Vector) -> bool:
    return float(np.sqrt(np.nanmean(lateral**2))) >= LEAST_ACCELERATION
