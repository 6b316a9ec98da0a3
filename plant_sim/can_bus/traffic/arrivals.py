"""Arrival curves: greatest number of frames of one identifier in any window of time.

With period T, jitter J and minimum distance d it is min(⌈(t + J)/T⌉, ⌈t/d⌉) in a window of length t
(Richter, Ernst 2002). For a recorded identifier only an interval for each queueing instant is
known; the curve holds for all instants within these intervals. Frames that are missing or late
leave it as it is: later frames are then released later.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

LEAST_FRAMES: Final = 6
"""Least number of frames from which a period is inferred."""
_ON_GRID: Final = 0.9
"""Least share of frames that follow another after one period; else it is event-driven."""
_CONFIDENCE: Final = 0.99
_HALVINGS: Final = 7
_WINDOW_NS: Final = 10e6
"""Window in which the curve of an event-driven identifier is made as tight as possible, ns."""


class Arrivals(NamedTuple):
    """Arrival curve of one identifier, and the releases of its frames, in nanoseconds.

    ``periodic``: no frame is later than the next one's release. ``jitter``: of a periodic one the
    span of the queueing instants after their releases, with what the next ones may add to it with a
    probability of 99 %; else the least with which the curve holds for the log.
    """

    periodic: bool
    period: float
    jitter: int
    distance: int
    releases: NDArray[np.float64]


def find_arrivals(
    earliest: NDArray[np.int64], latest: NDArray[np.int64], *, duration_ns: int
) -> Arrivals:
    """Return the arrival curve of frames queued between ``earliest`` and ``latest``.

    Args:
        earliest: instants in nanoseconds, one entry per frame.
        latest: likewise, sorted.
        duration_ns: of the log, the period of an identifier with one frame.
    """
    count = len(latest)
    if count < 2:
        return Arrivals(False, float(max(duration_ns, 1)), 0, 0, earliest.astype(float))
    distance = max(int((earliest[1:] - latest[:-1]).min()), 0)
    if count >= LEAST_FRAMES:
        steps = np.maximum(np.round(np.diff(latest) / np.median(np.diff(latest)).clip(1.0)), 1.0)
        period = _period(latest, steps)
        span, releases = _curve(earliest, latest, period)
        if span < period and np.mean(steps == 1.0) >= _ON_GRID:
            return Arrivals(True, period, _extrapolated(span, count), distance, releases)
    mean = max(float(latest[-1] - earliest[0]) / (count - 1), 1.0)
    curves = [(T, *_curve(earliest, latest, T)) for T in (mean / 2**k for k in range(_HALVINGS))]
    best = min(curves, key=lambda c: (-(-(_WINDOW_NS + c[1]) // c[0]), -c[0]))
    return Arrivals(False, best[0], best[1], distance, best[2])


def _period(times: NDArray[np.int64], steps: NDArray[np.float64]) -> float:
    """Return the period, so many of which lie between a frame and the next: some are missing."""
    places = np.cumsum(np.r_[0.0, steps])
    return max(float(np.polyfit(places, times - times[0], 1)[0]), 1.0)


def _extrapolated(span: int, count: int) -> int:
    # of n uniform draws the range is a Beta(n − 1, 2) share of the whole
    # a sixth of a second that only a log needs
    from scipy.special import betaincinv  # noqa: PLC0415

    return int(np.ceil(span / float(betaincinv(count - 1, 2, 1.0 - _CONFIDENCE))))


def _curve(
    earliest: NDArray[np.int64], latest: NDArray[np.int64], period: float
) -> tuple[int, NDArray[np.float64]]:
    """Return the least jitter with which a curve of this period holds, ns, and the releases.

    Releases are at least the period apart, and every frame is queued within the jitter after its
    own, wherever in its interval that is.
    """
    # times are whole ns: the first one off keeps the differences exact
    grid = np.arange(len(latest)) * period
    most = np.maximum.accumulate(latest - latest[0] - grid)
    jitter = int(np.ceil(max(float(np.max(most - (earliest - latest[0] - grid))), 0.0)))
    return jitter, most + grid - jitter + latest[0]
