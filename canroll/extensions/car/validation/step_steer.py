"""A step steer (ISO 7401), compared in the manner of ISO 22140.

Steady values per steering-wheel angle, response times from half of the steering to 90 % of the
steady value, peak response times and overshoots, of yaw rate, lateral acceleration and roll.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from canroll.errors import CanrollError
from canroll.extensions.car.identification.pieces import SAMPLE
from canroll.extensions.car.validation.criterion import GAINS, Criterion, Judged
from canroll.extensions.car.validation.manoeuvre import Instants, step_instants
from canroll.extensions.car.validation.replayed import Drive, Stretch
from canroll.extensions.car.validation.tolerances import Tolerance
from canroll.typing import Vector

STEADY = 0.5
"""Time (s) at the end of the held steering over which the steady value is the mean."""
STILL = 0.5
"""Time (s) before the step over which a signal is zeroed."""
OVERSHOOT = 0.02
"""A smaller overshoot, a share of the steady value, has no peak."""


def judge(drive: Drive, tolerances: Mapping[str, Tolerance]) -> Judged:
    """Compare the figures of the test.

    Raises:
        CanrollError: there is no step in the log.
    """
    for stretch in drive.stretches:
        instants = step_instants(stretch)
        if instants is not None:
            return Judged(tuple(_criteria(drive, stretch, instants, tolerances)))
    raise CanrollError(f"{drive.log}: its steering is no step: choose another --manoeuvre")


def _criteria(
    drive: Drive, stretch: Stretch, instants: Instants, tolerances: Mapping[str, Tolerance]
) -> Iterator[Criterion]:
    before = slice(max(0, instants.begin - 2 * round(STILL / SAMPLE)), None)
    start = slice(before.start, instants.begin - round(STILL / SAMPLE))
    last = slice(instants.end - round(STEADY / SAMPLE), instants.end)
    step = float(np.mean(stretch.steering[last]) - np.mean(stretch.steering[start]))
    for name, (label, unit, factor) in GAINS.items():
        if name not in drive.names:
            continue
        figures = []
        for signals in (stretch.measured, stretch.simulated):
            change = signals[name] - np.nanmean(signals[name][start])
            figures.append(_figures(change, instants, float(np.nanmean(change[last]))))
        (steady, response, over, peak), (steady_s, response_s, over_s, peak_s) = figures
        gain, gain_s = factor * steady / step, factor * steady_s / step
        allowed = tolerances["gain"].of(gain)
        yield Criterion(f"{label}, gain", gain, gain_s, unit, allowed)
        allowed = tolerances["time"].of(response)
        yield Criterion(f"{label}, response time", response, response_s, "s", allowed)
        allowed = tolerances["overshoot"].of(over)
        yield Criterion(f"{label}, overshoot", over, over_s, "of steady", allowed)
        if min(over, over_s) > OVERSHOOT:
            allowed = tolerances["time"].of(peak)
            yield Criterion(f"{label}, peak response time", peak, peak_s, "s", allowed)


def _figures(
    change: Vector, instants: Instants, steady: float
) -> tuple[float, float, float, float]:
    """Return steady value, response time, overshoot and peak response time."""
    share = change[: instants.end] / steady
    after = share[instants.begin :]
    reached = np.flatnonzero(after >= 0.9)
    first = int(reached[0]) if reached.size else len(after)
    response = first * SAMPLE
    if 0 < first < len(after):  # between two samples
        low, high = after[first - 1], after[first]
        response -= SAMPLE * float((high - 0.9) / (high - low))
    peak = int(np.nanargmax(after))
    return steady, response, float(after[peak]) - 1.0, peak * SAMPLE
