"""A sine with dwell (FMVSS 126, S7), compared in the manner of ISO 19365.

Peaks of yaw rate and lateral acceleration and their instants, what is left of the yaw rate 1 and
1.75 s after the steering, and the lateral displacement 1.07 s after its begin, which FMVSS 126
defines.
"""

from collections.abc import Collection, Iterator, Mapping

import numpy as np

from canroll.errors import CanrollError
from canroll.extensions.car.identification.pieces import SAMPLE
from canroll.extensions.car.validation.criterion import Criterion, Judged
from canroll.extensions.car.validation.manoeuvre import Instants, dwell_instants
from canroll.extensions.car.validation.replayed import Drive, Stretch
from canroll.extensions.car.validation.tolerances import Tolerance
from canroll.typing import Vector

DISPLACED = 1.07
"""Time (s) after the begin of the steering at which FMVSS 126 asks for the displacement."""
LEFT = (1.0, 1.75)
"""Times (s) after the end of the steering at which it asks for the yaw rate."""
_SIGNALS = {
    "yaw_rate": ("yaw rate", "°/s", float(np.degrees(1.0))),
    "lateral_acceleration": ("lateral acceleration", "m/s²", 1.0),
}


def judge(drive: Drive, tolerances: Mapping[str, Tolerance]) -> Judged:
    """Compare the figures of the test.

    Raises:
        CanrollError: there is no sine with dwell in the log.
    """
    for stretch in drive.stretches:
        instants = dwell_instants(stretch)
        if instants is not None:
            names = {*drive.names} & {*_SIGNALS}
            return Judged(tuple(_criteria(stretch, instants, names, tolerances)))
    raise CanrollError(
        f"{drive.log}: its steering is no sine of 0.7 Hz with a dwell: choose another --manoeuvre"
    )


def _criteria(
    stretch: Stretch,
    instants: Instants,
    names: Collection[str],
    tolerances: Mapping[str, Tolerance],
) -> Iterator[Criterion]:
    begin, end = instants.begin, instants.end
    side = float(np.sign(stretch.steering[begin]))
    for name in (name for name in _SIGNALS if name in names):
        label, unit, factor = _SIGNALS[name]
        measured, simulated = (
            _peaks(factor * side * signals[name], begin, end)
            for signals in (stretch.measured, stretch.simulated)
        )
        for number, word in enumerate(("first", "second")):
            (at, value), (at_simulated, value_simulated) = measured[number], simulated[number]
            allowed = tolerances["peak"].of(value)
            yield Criterion(f"{label}, {word} peak", value, value_simulated, unit, allowed)
            yield Criterion(
                f"{label}, {word} peak at",
                (at - begin) * SAMPLE,
                (at_simulated - begin) * SAMPLE,
                "s",
                tolerances["time"].of((at - begin) * SAMPLE),
            )
    for delay in LEFT if "yaw_rate" in names else ():
        place = end + round(delay / SAMPLE)
        if place >= len(stretch.time):
            continue
        shares = [
            side * signals["yaw_rate"][place] / _peaks(side * signals["yaw_rate"], begin, end)[1][1]
            for signals in (stretch.measured, stretch.simulated)
        ]
        allowed = tolerances["decay"].of(shares[0])
        label = f"yaw rate left after {delay:g} s"
        yield Criterion(label, float(shares[0]), float(shares[1]), "of peak", allowed)
    if "lateral_acceleration" not in names:
        return
    moved = [
        _displacement(side * signals["lateral_acceleration"], begin)
        for signals in (stretch.measured, stretch.simulated)
    ]
    allowed = tolerances["displacement"].of(moved[0])
    yield Criterion("lateral displacement", moved[0], moved[1], "m", allowed)


def _peaks(values: Vector, begin: int, end: int) -> tuple[tuple[int, float], tuple[int, float]]:
    """Return sample and value of the first peak, and of the one to the other side after it."""
    during = values[begin : end + round(0.5 / SAMPLE)]
    second = begin + int(np.nanargmin(during))
    first = begin + int(np.nanargmax(values[begin : second + 1]))
    return (first, float(values[first])), (second, float(values[second]))


def _displacement(lateral: Vector, begin: int) -> float:
    """Integrate the lateral acceleration twice, as FMVSS 126 does."""
    count = round(DISPLACED / SAMPLE)
    part = lateral[begin : begin + count]
    return float(np.sum(np.cumsum(part)) * SAMPLE**2)
