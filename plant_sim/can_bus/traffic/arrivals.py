"""Arrival curves: greatest number of frames of one identifier in any window of time.

With period T, jitter J and minimum distance d it is min(⌈(t + J)/T⌉, ⌈t/d⌉) in a window of length t
(Richter, Ernst 2002). For a recorded identifier only an interval for each queueing instant is
known; the curve holds for all instants within these intervals.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from plant_sim.can_bus.traffic.periodicity import Grid, find_grid

PERIODIC: Final = "periodic"
MIXED: Final = "mixed"
EVENT: Final = "event-driven"
LEAST_FRAMES: Final = 6
"""Least number of frames from which a period is inferred."""
_KNOWN_BEST: Final = 0.9
"""Share of the frames, with the best-known releases, from which the jitter is inferred: the others
were released somewhere within long busy periods."""
_CONFIDENCE: Final = 0.99
_FILLED_PERIODIC: Final = 0.9
_FILLED_MIXED: Final = 0.8
_ON_GRID_MIXED: Final = 0.5
_WINDOW_NS: Final = 10e6
"""Window in which the curve of an event-driven identifier is made as tight as possible, ns."""


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Arrival curve of one identifier, in nanoseconds, and its evidence.

    Attributes:
        kind: ``periodic``, ``mixed`` (periodic with further frames) or ``event-driven``.
        period: of the curve; ``cycle`` is the period of a mixed one's periodic part.
        jitter: greatest delay after the nominal release.
        distance: minimum distance of two frames, 0: unknown.
        cycle: inferred period of the periodic part, 0: none.
        offset: first nominal release of the grid, from the log's start.
        frames: number recorded; ``between``: those not on the grid.
        missing: grid points in the log without a frame; ``restarts``: jumps of the phase.
        exact: frames on the grid with exactly known release; for nine tenths it is known within
            ``uncertainty``, by which the jitter may be overestimated.
        residual: root mean square deviation of releases from the grid.
        confidence: distribution-free probability that the next release lies within the recorded
            jitter, (n − 1)/(n + 1) for n releases; 0 without a grid.
    """

    kind: str
    period: float
    jitter: int
    distance: int
    cycle: float
    offset: int
    frames: int
    between: int
    missing: int
    restarts: int
    exact: int
    uncertainty: int
    residual: float
    confidence: float


def find_arrivals(
    earliest: NDArray[np.int64],
    latest: NDArray[np.int64],
    exact: NDArray[np.bool_],
    *,
    cuts: NDArray[np.int64],
    duration_ns: int,
) -> Arrivals:
    """Return the arrival curve of frames queued between ``earliest`` and ``latest``.

    Args:
        earliest: sorted instants in nanoseconds, one entry per frame.
        latest: likewise; where ``exact``, equal to ``earliest``.
        exact: mask of the exactly known ones.
        cuts: instants within what was cut out of the log.
        duration_ns: of the log.
    """
    count = len(latest)
    if count < LEAST_FRAMES:
        return _events(earliest, latest, None, duration_ns)
    grid = find_grid(latest, cuts)
    if grid.on.all() and grid.filled >= _FILLED_PERIODIC and not grid.restarts:
        return _periodic(earliest, latest, exact, grid)
    return _events(earliest, latest, grid, duration_ns)


def _periodic(
    earliest: NDArray[np.int64],
    latest: NDArray[np.int64],
    exact: NDArray[np.bool_],
    grid: Grid,
) -> Arrivals:
    width = latest - earliest
    uncertainty = int(np.quantile(width, _KNOWN_BEST, method="higher"))
    chosen = width <= uncertainty
    known = int(chosen.sum())
    period = _narrowest(grid.places[chosen], latest[chosen], grid.period)
    # times are whole ns: the first one off keeps the differences exact
    shift = int(latest[0])
    places = grid.places * period
    low, high = earliest - shift - places, latest - shift - places
    # of n uniform draws the range is a Beta(n − 1, 2) share of the whole
    # a sixth of a second that only a log needs
    from scipy.special import betaincinv  # noqa: PLC0415

    share = float(betaincinv(known - 1, 2, 1.0 - _CONFIDENCE))
    floor = min(float(low[chosen].min()), float(high.min()))
    seen = max(float(high[chosen].max()), float(low.max())) - floor
    jitter = uncertainty + (seen - uncertainty) / share if seen > uncertainty else seen
    middle = high[chosen]
    residual = float(np.sqrt(np.mean((middle - middle.mean()) ** 2)))
    nominal = shift + floor
    return Arrivals(
        kind=PERIODIC,
        period=period,
        jitter=int(np.ceil(jitter)),
        distance=0,
        cycle=period,
        offset=round(nominal % period),
        frames=len(latest),
        between=0,
        missing=round(len(latest) / grid.filled) - len(latest),
        restarts=0,
        exact=int(exact.sum()),
        uncertainty=uncertainty,
        residual=residual,
        confidence=(known - 1) / (known + 1),
    )


def _narrowest(places: NDArray[np.int64], times: NDArray[np.int64], period: float) -> float:
    """Return the period near ``period`` with the least spread of phases, ns."""
    shifted = (times - times[0]).astype(float)
    span = max(int(places[-1] - places[0]), 1)
    reach = float(np.ptp(shifted - places * period)) / span
    low, high = period - reach, period + reach
    # the width is convex in the period
    for _ in range(60):
        left, right = low + (high - low) / 3.0, high - (high - low) / 3.0
        if np.ptp(shifted - places * left) <= np.ptp(shifted - places * right):
            high = right
        else:
            low = left
    return 0.5 * (low + high)


def _events(
    earliest: NDArray[np.int64], latest: NDArray[np.int64], grid: Grid | None, duration_ns: int
) -> Arrivals:
    """Return a curve that holds for the log itself, for frames without a period."""
    count = len(latest)
    mixed = (
        grid is not None
        and grid.filled >= _FILLED_MIXED
        and grid.on.sum() >= max(LEAST_FRAMES, _ON_GRID_MIXED * count)
    )
    if count < 2:
        period, jitter, distance = float(max(duration_ns, 1)), 0, 0
    else:
        distance = max(int((earliest[1:] - latest[:-1]).min()), 0)
        mean = max(float(latest[-1] - earliest[0]) / (count - 1), 1.0)
        candidates = [mean / 2**k for k in range(7)]
        if mixed and grid is not None:
            candidates += [grid.period / k for k in (1, 2, 3)]
        curves = [(T, _jitter(earliest, latest, T)) for T in candidates]
        period, jitter = min(curves, key=lambda c: (-(-(_WINDOW_NS + c[1]) // c[0]), -c[0]))
    cycle = grid.period if mixed and grid is not None else 0.0
    on = grid.on if mixed and grid is not None else np.zeros(count, bool)
    return Arrivals(
        kind=MIXED if mixed else EVENT,
        period=period,
        jitter=jitter,
        distance=distance,
        cycle=cycle,
        offset=int(latest[on][0] % round(cycle)) if cycle else 0,
        frames=count,
        between=count - int(on.sum()),
        missing=round(on.sum() / grid.filled - on.sum()) if cycle and grid is not None else 0,
        restarts=grid.restarts if cycle and grid is not None else 0,
        exact=0,
        uncertainty=0,
        residual=0.0,
        confidence=0.0,
    )


def _jitter(earliest: NDArray[np.int64], latest: NDArray[np.int64], period: float) -> int:
    """Return the least jitter with which a curve of this period holds for the frames, ns."""
    releases = np.arange(len(latest)) * period
    most = np.maximum.accumulate(latest - releases)
    return int(np.ceil(max(float(np.max(most - (earliest - releases))), 0.0)))
