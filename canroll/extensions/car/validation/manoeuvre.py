"""Which manoeuvre a log is, by its steering: ISO 4138, ISO 7401, FMVSS 126, or free driving."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from canroll.extensions.car.identification.pieces import SAMPLE
from canroll.extensions.car.validation.replayed import Drive, Stretch
from canroll.plant_sim.driving.steer_maneuvers import START, TABLE_STEP, sine_with_dwell_table
from canroll.typing import Vector

STEADY_CIRCLE, STEP_STEER, SINE_SWEEP, SINE_WITH_DWELL, FREE = MANOEUVRES = (
    *("steady_circle", "step_steer", "sine_sweep", "sine_with_dwell", "free"),
)
"""The manoeuvres that are judged in a way of their own, and all else."""
WORDS = {
    "steady_circle": "steady circle (ISO 4138, as ISO 19364 compares it)",
    "step_steer": "step steer (ISO 7401, as ISO 22140 compares it)",
    "sine_sweep": "sine sweep (ISO 7401)",
    "sine_with_dwell": "sine with dwell (FMVSS 126, as ISO 19365 compares it)",
    "free": "free driving",
}

LIKE = 0.97
"""Correlation with the steering of FMVSS 126 from which it is that one."""
QUIET = 0.08
"""Steering before a step, or held after it, varies by less than this share of the step."""
HELD = 1.5
"""A step is held for at least this time (s)."""
RISE = 0.6
"""A step rises from 10 to 90 % in less (s): ISO 7401 asks for 200 °/s and more at the wheel."""
SLOW = 0.4
"""Largest change (m/s³) of the lateral acceleration of a steady circle, but for 5 % of the time."""
SMOOTH = 1.0
"""Time (s) over which that change is measured."""
CURVE = 0.5
"""Least lateral acceleration (m/s²) of a circle."""
HALF_WAVES = 8
SWEPT = 3.0
"""A sweep has at least so many half waves, and its highest frequency is so often the lowest."""
SMALL = 0.3
"""Half waves smaller than this share of the largest are straight driving, or noise."""
UNEVEN = 0.2
"""A half wave of a sweep may be longer than the one before by so much (logarithm)."""


@dataclass(frozen=True, slots=True)
class Instants:
    """Samples of a stretch at which the steering begins and ends (sine with dwell, step)."""

    begin: int
    end: int


def recognised(drive: Drive) -> str:
    """Return the manoeuvre that every stretch of a drive is, else free driving."""
    kinds = {_of_stretch(stretch) for stretch in drive.stretches}
    return kinds.pop() if len(kinds) == 1 else FREE


def _of_stretch(stretch: Stretch) -> str:
    if dwell_instants(stretch) is not None:
        return SINE_WITH_DWELL
    if step_instants(stretch) is not None:
        return STEP_STEER
    # its points are over v r
    if "yaw_rate" in stretch.measured and _is_circle(stretch):
        return STEADY_CIRCLE
    if _is_sweep(stretch.steering[stretch.inside]):
        return SINE_SWEEP
    return FREE


def _is_circle(stretch: Stretch) -> bool:
    """Slow, as ISO 4138 asks for of a continuous increase, and to one side."""
    lateral = stretch.lateral[stretch.inside]
    lateral = lateral[np.isfinite(lateral)]
    count = round(SMOOTH / SAMPLE)
    if len(lateral) < 2 * count:
        return False
    smooth = np.convolve(lateral, np.ones(count) / count, "valid")
    change = np.abs(smooth[count:] - smooth[:-count]) / SMOOTH
    if not change.size or np.quantile(change, 0.95) > SLOW:
        return False
    return bool(np.abs(smooth).max() > CURVE and np.all(smooth * np.sign(smooth.mean()) > -0.3))


def dwell_instants(stretch: Stretch) -> Instants | None:
    """Return begin and end of the steering of a sine with dwell; None without one.

    The begin is where the angle passes 5° at the wheel or, of small ones, a tenth of its peak.
    """
    steering = stretch.steering
    template = sine_with_dwell_table(1.0)[:: round(SAMPLE / TABLE_STEP)]
    before = round(START / SAMPLE)
    template = template[: before + round((1.0 / 0.7 + 0.5 + 0.5) / SAMPLE)]
    if len(steering) < len(template):
        return None
    windows = np.lib.stride_tricks.sliding_window_view(steering, len(template))
    sizes = np.linalg.norm(windows, axis=1) * np.linalg.norm(template)
    likeness = np.abs(windows @ template) / np.maximum(sizes, 1e-9)
    # of several, as of noise on the straight, the one with the largest steering
    likeness = np.where(np.abs(windows).max(axis=1) > 0.7 * np.abs(steering).max(), likeness, 0.0)
    best = int(np.argmax(likeness))
    if likeness[best] < LIKE:
        return None
    window = np.abs(windows[best])
    begin = int(np.argmax(window > min(np.radians(5.0), 0.1 * window.max())))
    return Instants(best + begin, best + before + round((1.0 / 0.7 + 0.5) / SAMPLE))


def step_instants(stretch: Stretch) -> Instants | None:
    """Return where the steering passes half of a step and where it is no longer held.

    None where it is no step: still before, one quick rise, then held.
    """
    steering, before = stretch.steering, round(0.5 / SAMPLE)
    held = round(HELD / SAMPLE)
    if len(steering) < before + held:
        return None
    rate = np.abs(np.gradient(_smooth(steering), SAMPLE))
    middle = int(np.argmax(rate))
    if middle < before or len(steering) - middle < held:
        return None
    settle = middle + round(RISE / SAMPLE)
    start = float(np.mean(steering[max(0, middle - 2 * before) : middle - before // 2]))
    final = float(np.mean(steering[settle : middle + held]))
    size = final - start
    if abs(size) < np.radians(3.0):
        return None
    share = (steering - start) / size
    rise = share[middle - before : settle]
    passed = np.flatnonzero(rise > 0.1), np.flatnonzero(rise > 0.9)
    if not passed[0].size or not passed[1].size:
        return None
    if (passed[1][0] - passed[0][0]) * SAMPLE > RISE:
        return None
    if np.abs(share[: middle - before // 2]).max() > QUIET:
        return None
    away = np.abs(share[settle:] - 1.0) > QUIET
    end = settle + int(np.argmax(away)) if away.any() else len(share)
    if end - middle < held:
        return None
    half = middle - before + int(np.flatnonzero(rise > 0.5)[0])
    return Instants(half, end)


def _smooth(values: Vector) -> Vector:
    return np.asarray(np.convolve(np.pad(values, 2, mode="edge"), np.ones(5) / 5, "valid"))


def _is_sweep(steering: Vector) -> bool:
    """Half waves of one size that become ever shorter, or ever longer."""
    smooth = _smooth(steering - np.median(steering))
    waves = [wave for wave in _half_waves(smooth) if wave[1] > SMALL * np.abs(smooth).max()]
    if len(waves) < HALF_WAVES + 2:
        return False
    # the first and the last may be cut
    inner = np.array([length for length, _ in waves[1:-1]], float)
    if inner[-1] > inner[0]:
        inner = inner[::-1]
    falling = np.diff(np.log(inner)) < UNEVEN
    return bool(falling.all() and inner[0] / inner[-1] > SWEPT)


def _half_waves(values: Vector) -> Iterator[tuple[int, float]]:
    """Yield length in samples and peak of each stretch of one sign."""
    edges = np.flatnonzero(np.diff(np.sign(values))) + 1
    for part in np.split(values, edges):
        if len(part):
            yield len(part), float(np.abs(part).max())
