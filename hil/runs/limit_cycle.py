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
"""Fraction of a step by which ticks of a real-time run may start early or late."""
LEAST_MOMENT = 50.0
DECAY = 0.7
EVENNESS = 0.45
EXCITED = 0.6
AVERAGES = (0.0, 1.0, 0.5)
"""Lengths of the subtracted moving averages, s."""


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
    """Return the alternating extrema of ``values``, ignoring changes below ``hysteresis``."""
    return np.array(_turns(values.tolist(), hysteresis), dtype=np.int64)


def _turns(values: list[float], hysteresis: float) -> list[int]:
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
    return turns


def detect(
    t: Vector, command: Vector, t_passive: Vector, roll_passive: Vector
) -> LimitCycle | None:
    """Return the longest limit cycle of ``command``, or None.

    A limit cycle consists of oscillations that do not decay, have equal periods, and last for at
    least three periods and one second. The command is searched both as it is and with its moving
    average removed, as a limit cycle is superimposed on the command of the manoeuvre. If the
    passive roll angle oscillates as often in that time, it is the manoeuvre and not a limit cycle.

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
        cycles = list(_cycles(t, _without_average(command, t, window), threshold))
        if cycles:
            roll = _without_average(roll_passive, t_passive, window)
            found += [cycle for cycle in cycles if not _excited(cycle, t_passive, roll)]
    return max(found, key=lambda cycle: cycle.end - cycle.start, default=None)


def _evenly(t: Vector, values: Vector) -> tuple[Vector, Vector]:
    """Return equally spaced times and the values there; unchanged if already equally spaced."""
    steps = np.diff(t)
    step = float(np.median(steps))
    if np.max(np.abs(steps - step)) <= UNEVEN * step:
        return t, values
    even = np.arange(t[0], t[-1], step)
    return even, np.interp(even, t, values)


def _without_average(values: Vector, t: Vector, window: float) -> Vector:
    """Return equally spaced ``values`` minus their average over ``window``; 0: unchanged."""
    count = min(round(window / float(t[1] - t[0])), len(values))
    if count < 2:
        return values
    ones = np.ones(count)
    average = np.convolve(values, ones, "same")
    # the values that the window covers: fewer than all of it only near the ends
    average /= np.convolve(np.ones(len(values)), ones, "same")
    return np.subtract(values, average, out=average)


def _cycles(t: Vector, values: Vector, threshold: float) -> Iterator[LimitCycle]:
    """Yield every sequence of regular oscillations that do not decay for three periods."""
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
    """Whether the newest oscillation continues the previous ones."""
    if swings[-1] < DECAY * np.max(swings):
        return False
    usual = float(np.median(spans[:-1]))
    return bool(abs(spans[-1] - usual) <= EVENNESS * usual)


def _excited(cycle: LimitCycle, t: Vector, roll: Vector) -> bool:
    """Whether the manoeuvre itself oscillates as often at that time."""
    inside = roll[(t >= cycle.start) & (t <= cycle.end)]
    if not len(inside):
        return False
    turns = turning_points(inside, SHARE_OF_PEAK * float(np.max(np.abs(roll))))
    return len(turns) >= EXCITED * 2 * cycle.frequency * (cycle.end - cycle.start)
