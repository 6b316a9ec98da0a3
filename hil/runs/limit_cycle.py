"""Detection of limit cycles: the command oscillates although the manoeuvre does not."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canroll.typing import Vector

HALF_CYCLES_MIN = 6
SECONDS_MIN = 1.0
SHARE_OF_PEAK = 0.1
UNEVEN = 0.1
"""Share of a step by which the ticks of a run in real time may start early or late."""
LEAST_MOMENT = 50.0
DECAY = 0.7
EVENNESS = 0.45
EXCITED = 0.6
AVERAGES = (0.0, 1.0, 0.5)
"""Lengths of the moving averages taken off, s."""


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """A sustained oscillation of the command: Hz, N·m either side of its middle, s."""

    frequency: float
    amplitude: float
    start: float
    end: float

    def __str__(self) -> str:
        return (
            f"limit cycle: the command oscillates by ±{self.amplitude:.0f} N·m at "
            f"{self.frequency:.1f} Hz from {self.start:.1f} s to {self.end:.1f} s"
        )


def turning_points(values: Vector, hysteresis: float) -> NDArray[np.int64]:
    """Return where ``values`` turns, ignoring wiggles smaller than ``hysteresis``; alternating."""
    turns: list[int] = []
    low = high = 0
    rising: bool | None = None
    for i, value in enumerate(values):
        if value > values[high]:
            high = i
        if value < values[low]:
            low = i
        if rising is not False and values[high] - value > hysteresis:
            turns.append(high)
            rising, low = False, i
        elif rising is not True and value - values[low] > hysteresis:
            turns.append(low)
            rising, high = True, i
        elif rising is True:
            low = i
        elif rising is False:
            high = i
    return np.array(turns, dtype=np.int64)


def detect(
    t: Vector, command: Vector, t_passive: Vector, roll_passive: Vector
) -> LimitCycle | None:
    """Return the longest limit cycle of ``command``, or None.

    Swings count as one as long as they do not decay, take equally long, and go on for three
    periods and a second. They are looked for in the command as it is, and in what is left of it
    without its moving average, for a limit cycle rides on what the manoeuvre asks for. A manoeuvre
    that itself swings as often in that time, told by the passive roll angle, is no limit cycle.

    Args:
        t: times of the controlled run's ticks, s; a run in real time may have missed some.
        command: moment commanded at these times, N·m.
        t_passive: times of the same manoeuvre without control, s.
        roll_passive: roll angle at these times, rad.
    """
    if len(t) < 3 or t[-1] - t[0] < SECONDS_MIN:
        return None
    t, command = _evenly(t, command)
    threshold = max(SHARE_OF_PEAK * float(np.max(np.abs(command))), LEAST_MOMENT)
    found = []
    for window in AVERAGES:
        left = _without_average(command, t, window)
        roll = _without_average(roll_passive, t_passive, window)
        found += [
            cycle for cycle in _cycles(t, left, threshold) if not _excited(cycle, t_passive, roll)
        ]
    return max(found, key=lambda cycle: cycle.end - cycle.start, default=None)


def _evenly(t: Vector, values: Vector) -> tuple[Vector, Vector]:
    """Return times at equal steps and the values there; what has equal steps is left as it is."""
    steps = np.diff(t)
    step = float(np.median(steps))
    if np.max(np.abs(steps - step)) <= UNEVEN * step:
        return t, values
    even = np.arange(t[0], t[-1], step)
    return even, np.interp(even, t, values)


def _without_average(values: Vector, t: Vector, window: float) -> Vector:
    """Return ``values`` at equal steps of ``t`` less their average over ``window``; 0: as is."""
    count = min(round(window / float(t[1] - t[0])), len(values))
    if count < 2:
        return values
    ones = np.ones(count)
    return values - np.convolve(values, ones, "same") / np.convolve(
        np.ones(len(values)), ones, "same"
    )


def _cycles(t: Vector, values: Vector, threshold: float) -> Iterator[LimitCycle]:
    """Yield every stretch of even swings that do not decay and go on for three periods."""
    turns = turning_points(values, threshold)
    swings = np.abs(np.diff(values[turns]))
    spans = np.diff(t[turns])
    first = 0
    for last in range(1, len(swings) + 1):
        if last < len(swings) and _goes_on(swings[first : last + 1], spans[first : last + 1]):
            continue
        start, end = float(t[turns[first]]), float(t[turns[last]])
        if last - first >= HALF_CYCLES_MIN and end - start >= SECONDS_MIN:
            amplitude = float(np.mean(swings[first:last])) / 2
            yield LimitCycle((last - first) / 2 / (end - start), amplitude, start, end)
        first = last


def _goes_on(swings: Vector, spans: Vector) -> bool:
    """Whether the newest swing continues the ones before it."""
    usual = float(np.median(spans[:-1]))
    return bool(swings[-1] >= DECAY * np.max(swings) and abs(spans[-1] - usual) <= EVENNESS * usual)


def _excited(cycle: LimitCycle, t: Vector, roll: Vector) -> bool:
    """Whether the manoeuvre itself swings as often while the command does."""
    inside = roll[(t >= cycle.start) & (t <= cycle.end)]
    if not len(inside):
        return False
    turns = turning_points(inside, SHARE_OF_PEAK * float(np.max(np.abs(roll))))
    return len(turns) >= EXCITED * 2 * cycle.frequency * (cycle.end - cycle.start)
