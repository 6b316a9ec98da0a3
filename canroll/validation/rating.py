"""The rating of ISO/TS 18571 of a simulated signal against a measured one.

By the package ``objective-rating-metrics`` of the TU Graz. The standard's windows count in
samples, at 10 kHz for signals of a crash; those of a drive are a hundred times as slow and sampled
at 100 Hz.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from canroll.errors import optional
from canroll.identification.log_checks import LEAST_ACCELERATION
from canroll.identification.pieces import SAMPLE
from canroll.typing import Vector
from canroll.validation.replayed import Drive, runs

GRADES = ((0.94, "excellent"), (0.80, "good"), (0.58, "fair"))
"""Ratings above which ISO/TS 18571 has these words; below it is poor."""
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


def package() -> Any:  # noqa: ANN401
    """Return the module that rates.

    Raises:
        MissingExtraError: the package is not installed.
    """
    return optional("objective_rating_metrics.rating", "the rating of ISO/TS 18571", "validate")


def rate(measured: Vector, simulated: Vector, interval: float = SAMPLE) -> Rating:
    """Rate a simulated signal against a measured one, both (n,), every ``interval`` (s).

    Raises:
        MissingExtraError: the package ``objective-rating-metrics`` is not installed.
    """
    time = interval * np.arange(len(measured))
    curves = (np.column_stack((time, values)) for values in (measured, simulated))
    rated = package().ISO18571(*curves, dt=interval)
    return Rating(
        float(rated.overall_rating(-1)),
        float(rated.corridor_rating(-1)),
        float(rated.phase_rating(-1)),
        float(rated.magnitude_rating(-1)),
        float(rated.slope_rating(-1)),
    )


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
                if len(part) < SHORTEST / SAMPLE or not _steered(
                    stretch.measured["lateral_acceleration"][part]
                ):
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
