"""Detection of limit cycles: the command oscillates although nothing excites it.

An oscillation of the command is first looked for in the run itself (:func:`oscillations`), and is
not the manoeuvre's (:func:`unexcited`). Sensor noise, the road and the steering make stable loops
oscillate too, so the same run is then driven once more:
from one period of the oscillation on without noise and straight on. The response of a stable loop
decays there, a limit cycle and an unstable loop go on (:func:`goes_on`).
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
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
"""Least ratio of a swing to the largest one before it.

A stable loop with a damping ratio below about 0.03 decays less in three periods, and counts as a
limit cycle.
"""
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

    @property
    def established(self) -> float:
        """One period after its start, s: the loop is judged from its state at this time."""
        return self.start + 1 / self.frequency

    @property
    def watched(self) -> float:
        """How long the loop is watched without noise and straight on, s.

        As long as the oscillation lasted, and twice as long as the shortest limit cycle.
        """
        shortest = max(SECONDS_MIN, HALF_CYCLES_MIN / 2 / self.frequency)
        return max(self.end - self.start, 2 * shortest)


def goes_on(t: Vector, command: Vector, since: float) -> bool:
    """Whether ``command`` (N·m) oscillates from some time after ``since`` until its end.

    ``t`` (s) are the times of the ticks of a run without noise and straight on from ``since`` on,
    up to its end or to the tick at which the ECU opens the loop.
    """
    watched = t > since
    return any(
        cycle.end + 1 / cycle.frequency > t[-1]
        for _, cycle in oscillations(t[watched], command[watched])
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


def oscillations(t: Vector, command: Vector) -> list[tuple[float, LimitCycle]]:
    """Return the oscillations of a command, each with the length of the subtracted average.

    They do not decay, have equal periods, and last for at least three periods and one second. The
    command (N·m) at ``t`` (s) is searched as it is and with its moving average removed, as a limit
    cycle is superimposed on the command of the manoeuvre.
    """
    if len(t) < 3 or t[-1] - t[0] < SECONDS_MIN:
        return []
    t, command = _evenly(t, command)
    threshold = max(SHARE_OF_PEAK * float(np.max(np.abs(command))), LEAST_MOMENT)
    return [
        (window, cycle)
        for window in AVERAGES
        for cycle in _cycles(t, _without_average(command, t, window), threshold)
    ]


def unexcited(
    candidates: Sequence[tuple[float, LimitCycle]],
    passive: Callable[[], Iterable[tuple[Vector, Vector]]],
) -> list[LimitCycle]:
    """Return the :func:`oscillations` that the manoeuvre does not cause, the longest first.

    ``passive`` returns times (s) and roll angle (rad) of the manoeuvre without control, in pieces.
    """
    own: list[LimitCycle] = []
    for window in dict.fromkeys(window for window, _ in candidates):
        cycles = [cycle for length, cycle in candidates if length == window]
        inside: list[list[Vector]] = [[] for _ in cycles]
        peak = 0.0
        for t, roll in _pieces_without_average(passive(), window):
            peak = max(peak, float(np.max(np.abs(roll), initial=0.0)))
            for cycle, parts in zip(cycles, inside, strict=True):
                parts.append(roll[(t >= cycle.start) & (t <= cycle.end)])
        own += [
            cycle
            for cycle, parts in zip(cycles, inside, strict=True)
            if not _excited(cycle, np.concatenate(parts), peak)
        ]
    return sorted(own, key=lambda cycle: cycle.start - cycle.end)


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


def _pieces_without_average(
    pieces: Iterable[tuple[Vector, Vector]], window: float
) -> Iterator[tuple[Vector, Vector]]:
    """Yield times and :func:`_without_average` of values that come in pieces."""
    t, values, done, reach = np.zeros(0), np.zeros(0), 0, 0
    for piece in pieces:
        t, values = np.append(t, piece[0]), np.append(values, piece[1])
        if len(t) < 2:
            continue
        reach = round(window / float(t[1] - t[0])) + 1
        # the next piece belongs to the averages of the last values
        until = max(len(t) - reach, done)
        yield t[done:until], _without_average(values, t, window)[done:until]
        first = max(until - reach, 0)
        t, values, done = t[first:], values[first:], until - first
    if len(t) > done:
        yield t[done:], _without_average(values, t, window)[done:] if reach else values


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


def _excited(cycle: LimitCycle, roll: Vector, peak: float) -> bool:
    """Whether ``roll`` of the manoeuvre itself oscillates as often at that time."""
    if not len(roll):
        return False
    turns = turning_points(roll, SHARE_OF_PEAK * peak)
    return len(turns) >= EXCITED * 2 * cycle.frequency * (cycle.end - cycle.start)
