"""A log as pieces on a uniform time base: cut at gaps, resets and standstill, without outliers."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import degrees, inf

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.extensions.car.identification.drive_log import (
    DELIVERED,
    INPUTS,
    MOTION,
    OUTPUTS,
    QUANTITIES,
    Log,
)
from canroll.extensions.car.identification.smoothing import EXACT, Noise, smoothed
from canroll.plant_sim.bodies.ports import WHEELS
from canroll.typing import Vector
from canroll.vehicles import GRAVITY

SAMPLE = 0.01
"""Interval of the time base (s): the car does nothing above 20 Hz."""
RUN_IN = 1.0
"""First part of a piece (s), in which the car forgets that it was not driving straight before."""
SHORTEST = 2.0
"""A shorter piece (s) is left out."""
SLOWEST = 5.0
"""Speed (m/s) below which the plant's tyres are not valid."""
GAP = 0.15
"""Time (s) without a sample of an input after which nothing is known of the drive."""
OUTLIER = 12.0
"""Distance from the median of five neighbours, in usual ones, beyond which a sample is none.

It must also be more than any car moves between the two: :data:`FASTEST`.
"""
GRIP = 2.5 * GRAVITY
"""Lateral acceleration (m/s²) of racing slicks, as the largest friction of a vehicle file."""
FASTEST = {
    "steering": 40.0,  # rad/s: twice a steering robot's 1200 °/s
    "speed": 2.0 * GRIP,  # m/s²: braking with as much downforce as weight
    "yaw_rate": 4.0 * GRIP / 2.5,  # rad/s²: both axles at their grip, m a b of yaw inertia, l 2.5 m
    "roll_rate": 0.7 * GRIP / 0.5**2,  # rad/s²: its moment at 0.7 m, radius of gyration 0.5 m
    "roll": 4.0,  # rad/s: a car that falls on its side
    "sideslip": GRIP / SLOWEST + 2.0,  # rad/s: a_y/v − r
    **{f"travel_{wheel}": 5.0 for wheel in WHEELS},  # m/s: over a kerb
}
"""Largest change of a signal per second: samples farther from their neighbours are outliers.

Tyre forces build up in a sample's time, and so do moments: a lateral acceleration changes by twice
:data:`GRIP` at most, a moment by any amount.
"""
NAMED = 3
"""So many instants of outliers are named."""
SLOW, TURNED = 1.0 / 25.0, 0.2
"""Interval of samples (s), and share of its range by which steering then turns between two at most.

Of a sine that is π f dt: interpolation errs by (2π f dt)²/8 of the amplitude, 2 % there.
"""

SAME_TIME = 1e-9
"""Times (s) that differ by less are one: those of a log are decimal fractions."""


@dataclass(frozen=True, slots=True)
class Window:
    """Part of a log, from ``begin`` to before ``end`` (s of its clock)."""

    begin: float = -np.inf
    end: float = np.inf


EVERYTHING = Window()


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A stretch of driving, sampled every :data:`SAMPLE` from ``begin`` (s) on.

    ``steering`` (rad at the wheel) and ``speed`` (m/s) have shape (n,); ``measured`` (n, m) has the
    columns of ``names`` in SI units, NaN where there is no sample. ``steering_noise`` and
    ``speed_noise`` say how far the two inputs may be from those of the measured car. ``moments``
    (N·m) are those of actuators on the body, by the names of :data:`DELIVERED`; none are zero.
    """

    begin: float
    steering: Vector
    speed: Vector
    names: tuple[str, ...]
    measured: NDArray[np.float64]
    steering_noise: Noise = EXACT
    speed_noise: Noise = EXACT
    moments: Mapping[str, Vector] = field(default_factory=dict)
    moment_noise: Mapping[str, Noise] = field(default_factory=dict)

    @property
    def time(self) -> Vector:
        """Times of the samples (s)."""
        return np.asarray(self.begin + SAMPLE * np.arange(len(self.speed)), float)

    def compared(self, window: Window) -> NDArray[np.bool_]:
        """Return which values count: those measured in ``window``, after the run-in."""
        time = self.time
        inside = (time >= window.begin) & (time < window.end) & (time >= self.begin + RUN_IN)
        return inside[:, None] & np.isfinite(self.measured)

    def disturbed(self, generator: np.random.Generator) -> "Piece":
        """Return the piece with errors of its inputs as large as those they may have."""
        return replace(
            self,
            steering=self.steering + self.steering_noise.errors(self.time, generator),
            speed=self.speed + self.speed_noise.errors(self.time, generator),
            moments={
                name: moment + self.moment_noise[name].errors(self.time, generator)
                for name, moment in self.moments.items()
            },
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Clean:
    """A channel with increasing times, and the times at which its clock was set back."""

    times: Vector
    values: Vector
    resets: tuple[float, ...]
    remarks: tuple[str, ...]


def pieces(log: Log, window: Window) -> tuple[tuple[Piece, ...], tuple[str, ...]]:
    """Return the pieces of a log that cover ``window``, and what was left out, a line each.

    Raises:
        CanrollError: nothing is left.
    """
    names = tuple(name for name in OUTPUTS if name in log.channels)
    acting = tuple(name for name in DELIVERED if name in log.channels)
    clean = {name: _cleaned(log, name) for name in (*INPUTS, *acting, *names)}
    remarks = [*log.remarks]
    for name in MOTION:
        if name not in names:
            label = QUANTITIES[name].label
            remarks.append(f"no {label} in the log (else name it: --signal {name}=NAME)")
    for channel in clean.values():
        remarks += channel.remarks
    first = max(channel.times[0] for channel in clean.values())
    last = min(channel.times[-1] for channel in clean.values())
    begin, end = max(first, window.begin - RUN_IN), min(last, window.end)
    if not end - begin >= SHORTEST:
        raise CanrollError(
            f"{log.name}: the last signal begins at {first:.6g} s, the first ends at {last:.6g} s: "
            f"{max(end - begin, 0.0):.2g} s of it are chosen, at least {SHORTEST:g} s are needed"
        )
    parts = list(_stretches(clean, begin, end))
    left = sum(b - a for a, b in parts)
    if left < end - begin - 0.1:
        remarks.append(
            f"{end - begin - left:.1f} s of {end - begin:.1f} s left out: gaps, resets, slower "
            f"than {3.6 * SLOWEST:.0f} km/h, or shorter than {SHORTEST:g} s"
        )
    if not parts:
        raise CanrollError(
            f"{log.name}: no {SHORTEST:g} s of it without a gap and faster than "
            f"{3.6 * SLOWEST:.0f} km/h"
        )
    return tuple(_piece(clean, names, a, b) for a, b in parts), tuple(remarks)


def newer(times: Vector) -> NDArray[np.bool_]:
    """Return which times are later than all before them."""
    return np.concatenate(([True], np.diff(np.maximum.accumulate(times)) > 0))


def _cleaned(log: Log, name: str) -> _Clean:
    channel, label = log.channels[name], QUANTITIES[name].label
    times, values, remarks = channel.times, channel.values, []
    steps = np.diff(times)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 1.0
    # a clock that was set back: what follows is another drive, after the first
    back = np.flatnonzero(steps < -2 * usual)
    resets = []
    if back.size:
        times = times.copy()
        for i in back:
            times[i + 1 :] += times[i] - times[i + 1] + GAP + 2 * usual
            resets.append(float(times[i]))
        remarks.append(f"{label}: its time is set back {back.size} times: cut there")
    order = newer(times)
    times, values = times[order], values[order]
    if len(times) < 2:
        raise CanrollError(f"{log.name}: {channel.source}: its times do not increase")
    usual = float(np.median(np.diff(times)))
    far = _outliers(name, times, values)
    if far.any():
        remarks.append(
            f"{label}: {_counted(far.sum(), 'outlier')} left out, which no car can do: at "
            f"{_listed(times[far])} s"
        )
        times, values = times[~far], values[~far]
    gaps = np.diff(times) > max(GAP, 2.5 * usual)
    if gaps.sum() > len(resets):
        longest = float(np.diff(times).max())
        gap = _counted(gaps.sum() - len(resets), "gap")
        remarks.append(f"{label}: {gap}, the longest of {longest:.2f} s")
    if name == "steering" and usual > SLOW:
        turned = np.abs(np.diff(values)).max() / max(np.ptp(values), 1e-12)
        if turned > TURNED:
            rate = degrees(np.abs(np.diff(values) / np.diff(times)).max())
            remarks.append(
                f"{label}: {1 / usual:.3g} samples a second are too few for {rate:.0f} °/s: it "
                f"turns by {100 * turned:.0f} % of its range between two: log at 25 Hz or more"
            )
    block = max(int(SAMPLE / usual + 0.5), 1)
    if block > 1:  # a mean over a sample instead of picking one: noise above is no signal
        count = len(times) // block * block
        times = times[:count].reshape(-1, block).mean(axis=1)
        values = values[:count].reshape(-1, block).mean(axis=1)
    return _Clean(times, values, tuple(resets), tuple(remarks))


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("s" if count > 1 else "")


def _listed(times: Vector) -> str:
    """Return the first times (s)."""
    return ", ".join(f"{time:.2f}" for time in times[:NAMED]) + (
        ", …" if len(times) > NAMED else ""
    )


def _outliers(name: str, times: Vector, values: Vector) -> NDArray[np.bool_]:
    """Return which samples are so far from their neighbours as no car moves in the time between."""
    if len(values) < 5 or name in DELIVERED:
        return np.zeros(len(values), bool)
    around, between = (
        np.lib.stride_tricks.sliding_window_view(np.pad(each, 2, mode="edge"), 5)
        for each in (values, times)
    )
    away = np.abs(values - np.median(around, axis=1))
    scale = 1.4826 * np.median(away[away > 0]) if np.any(away > 0) else 0.0
    moved = FASTEST.get(name, inf) * np.abs(between - times[:, None]).max(axis=1)
    if name == "lateral_acceleration":
        moved = np.full(len(values), 2.0 * GRIP)
    return np.asarray(away > np.maximum(OUTLIER * scale, moved))


def _stretches(clean: dict[str, _Clean], begin: float, end: float) -> Iterator[tuple[float, float]]:
    """Yield begin and end of what can be driven: steering and speed known, fast enough."""
    cuts: list[tuple[float, float]] = []
    for name in (*INPUTS, *DELIVERED):
        if name not in clean:
            continue
        times = clean[name].times
        long = np.flatnonzero(np.diff(times) > GAP)
        cuts += [(float(times[i]), float(times[i + 1])) for i in long]
    speed = clean["speed"]
    slow = speed.values < SLOWEST
    edges = np.flatnonzero(np.diff(slow.astype(int)))
    bounds = [0, *(edges + 1).tolist(), len(slow)]
    for start, stop in pairwise(bounds):
        if slow[start]:
            cuts.append((float(speed.times[start]), float(speed.times[stop - 1])))
    at = begin
    for first, last in sorted(cuts):
        if first - at >= SHORTEST:
            yield at, min(first, end)
        at = max(at, last)
        if at >= end:
            return
    if end - at >= SHORTEST:
        yield at, end


def _piece(clean: dict[str, _Clean], names: tuple[str, ...], begin: float, end: float) -> Piece:
    time = begin + SAMPLE * np.arange(int((end - begin) / SAMPLE) + 1)

    def sampled(name: str) -> Vector:
        return np.asarray(np.interp(time, clean[name].times, clean[name].values))

    measured = np.column_stack([sampled(name) for name in names])
    for column, name in enumerate(names):
        times = clean[name].times
        usual = float(np.median(np.diff(times)))
        for i in np.flatnonzero(np.diff(times) > max(2.5 * usual, 2.5 * SAMPLE)):
            measured[(time > times[i]) & (time < times[i + 1]), column] = np.nan
    # noise of the speed would drive the car, and look like motion that the numbers explain
    values, speed_noise = smoothed(*_regular(clean["speed"], time[0], time[-1]))
    speed = np.asarray(np.interp(time, speed_noise.times, values))
    # the car itself filters the steering: only how large its noise is must be known
    _, steering_noise = smoothed(*_regular(clean["steering"], time[0], time[-1]))
    steering_noise = replace(steering_noise, weight=0.0)
    moments = {name: sampled(name) for name in DELIVERED if name in clean}
    noises = {name: smoothed(*_regular(clean[name], time[0], time[-1]))[1] for name in moments}
    return Piece(
        begin,
        sampled("steering"),
        speed,
        names,
        measured,
        steering_noise,
        speed_noise,
        moments,
        {name: replace(noise, weight=0.0) for name, noise in noises.items()},
    )


def _regular(channel: _Clean, begin: float, end: float) -> tuple[Vector, Vector]:
    """Return times and values of a channel's samples from ``begin`` to ``end``, none missing.

    Between neighbours that are several intervals apart there are as many more, on their line.
    """
    first = np.searchsorted(channel.times, begin + SAME_TIME, "right") - 1
    last = np.searchsorted(channel.times, end - SAME_TIME)
    times, values = channel.times[first : last + 1], channel.values[first : last + 1]
    steps = np.diff(times)
    apart = np.maximum(np.rint(steps / np.median(steps)), 1.0)
    places = np.concatenate(([0.0], np.cumsum(apart)))
    every = np.arange(places[-1] + 1.0)
    return np.interp(every, places, times), np.interp(every, places, values)
