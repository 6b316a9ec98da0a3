"""The time grid, if any, of the frames of one identifier.

The grid is tracked frame by frame: the next frame is expected one period after the last, with a
slow correction of the phase. Frames may be missing or in between, and a node may restart.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

_CORRECTION: Final = 0.2
"""Share of a frame's deviation by which the phase of the grid is corrected."""
_TOLERANCE: Final = 0.4
"""Greatest deviation of a frame from its place in the grid, as a share of the period."""
_RESTART: Final = 3
"""Consecutive frames off the grid after which a restart is assumed."""
_TRIAL: Final = 400
"""Number of frames on which candidate periods are tried."""
_STARTS: Final = 4
"""Number of first frames tried as the beginning of the grid."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Frames on a grid: ``period`` (ns), and the grid point of every frame.

    ``places``: grid points, −1 for a frame off the grid. ``filled``: share of grid points with a
    frame, of those that the log covers. ``restarts``: number of jumps of the phase.
    """

    period: float
    places: NDArray[np.int64]
    filled: float
    restarts: int

    @property
    def on(self) -> NDArray[np.bool_]:
        """Mask of the frames on the grid."""
        mask: NDArray[np.bool_] = self.places >= 0
        return mask

    @property
    def agreement(self) -> float:
        """Agreement of grid points and frames, 1 if each point has exactly one frame."""
        hits = int(self.on.sum())
        return 2.0 * hits / (hits / self.filled + len(self.places)) if hits else 0.0


def find_grid(times: NDArray[np.int64], cuts: NDArray[np.int64]) -> Grid:
    """Return the best grid for the sorted times (ns) of at least three frames.

    ``cuts``: instants within what was cut out of the log, where no frame is missing.
    """
    sample = times[:_TRIAL]
    trials = [
        (grid.agreement, grid.period, first)
        for period in _candidates(times)
        for first in range(min(_STARTS, len(sample) - 2))
        for grid in (_follow(sample, period, first),)
    ]
    _, period, first = max(trials)
    grid = _follow(times, period, first)
    if grid.restarts == 0 and grid.on.sum() > 2:
        # again with the period of the whole log
        period = float(np.polyfit(grid.places[grid.on], times[grid.on] - times[0], 1)[0])
        grid = _follow(times, period, first)
    return replace(grid, filled=_filled(grid, times, cuts))


def _filled(grid: Grid, times: NDArray[np.int64], cuts: NDArray[np.int64]) -> float:
    """Return the share of grid points with a frame, without those in what was cut out."""
    hits = np.flatnonzero(grid.on)
    after = np.unique(np.searchsorted(times[hits], cuts))
    after = after[(after > 0) & (after < len(hits))]
    absent = grid.places[hits[after]] - grid.places[hits[after - 1]] - 1
    return len(hits) / (len(hits) / grid.filled - int(absent.sum()))


def _candidates(times: NDArray[np.int64]) -> list[float]:
    """Return mean and median distance, and the commonest of frames 1, 2 and 3 apart, ns."""
    steps = np.diff(times)
    periods = [float(steps.mean()), float(np.median(steps))]
    for apart in (1, 2, 3):
        if len(times) > apart:
            distances = np.sort(times[apart:] - times[:-apart])
            high = np.searchsorted(distances, distances * 1.05, "right")
            low = np.searchsorted(distances, distances * 0.95, "left")
            best = int(np.argmax(high - low))
            periods.append(float(distances[low[best] : high[best]].mean()))
    return [period for period in dict.fromkeys(periods) if period > 0.0]


def _follow(times: NDArray[np.int64], period: float, first: int) -> Grid:
    stamps = times.tolist()
    places = np.full(len(stamps), -1, np.int64)
    places[first] = 0
    nominal, place, restarts, astray, last, hits = float(stamps[first]), 0, 0, 0, first, 1
    deviation = 0.0
    for i in range(first + 1, len(stamps)):
        step = round((stamps[i] - nominal) / period)
        off = stamps[i] - nominal - step * period
        if step == 0 and abs(off) < abs(deviation):
            # nearer to the place that the frame before has taken
            places[last], places[i], last = -1, place, i
            nominal += _CORRECTION * (off - deviation)
            deviation = off
        elif step > 0 and abs(off) <= _TOLERANCE * period:
            place, last, hits, astray = place + step, i, hits + 1, 0
            places[i] = place
            nominal += step * period + _CORRECTION * off
            deviation = (1.0 - _CORRECTION) * off
        elif step > 0:
            astray += 1
            if astray == _RESTART:
                place, last, hits, astray = place + max(step, 1), i, hits + 1, 0
                places[i], nominal, deviation = place, float(stamps[i]), 0.0
                restarts += 1
    return Grid(period, places, hits / (place + 1), restarts)
