"""What a car meets over distance: bumps, random roads after ISO 8608, and roads of a file."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from math import pi, radians

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.driving.drive import ManeuverPlan
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.typing import Vector

STEP = 0.05
"""Distance between the points of a road profile (m)."""

CLASSES = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6}
"""Displacement power spectral density at 0.1 cycles/m (m³), ISO 8608 table C.1, geometric mean."""

REFERENCE_FREQUENCY = 0.1
LOWEST_FREQUENCY = 0.011
HIGHEST_FREQUENCY = 2.83


SHAPES = ("cosine", "half_sine")
"""Of a bump: a whole cosine, which begins and ends level, or half a sine."""


def bumps(
    *, height: float, length: float, spacing: float, count: int, start: float, shape: str = "cosine"
) -> Vector:
    """Bumps of ``height`` over ``length``, the first at ``start`` (all m).

    Raises:
        UnknownNameError: a shape that is none of :data:`SHAPES`.
    """
    if shape not in SHAPES:
        raise UnknownNameError("shape of bumps", shape, SHAPES)
    s = np.arange(0.0, start + count * spacing + 2 * length, STEP)
    profile = np.zeros_like(s)
    for i in range(count):
        part = (s - start - i * spacing) / length
        inside = (part > 0) & (part < 1)
        if shape == "cosine":
            profile[inside] = 0.5 * height * (1 - np.cos(2 * np.pi * part[inside]))
        else:
            profile[inside] = height * np.sin(pi * part[inside])
    return profile


@lru_cache(maxsize=1)
def random_tracks(
    road_class: str, *, length: float, track: float, seed: int
) -> tuple[Vector, Vector]:
    """Left and right profile (m) of a road of that ISO 8608 class, waviness 2.

    ``length`` and ``track`` (distance between the wheel tracks) in m. Long waves are common to both
    tracks, short ones are not: their coherence at n cycles/m is 1/(1 + (n·track)²). Wavelengths of
    0.35 to 90 m. Starts level. The same ``seed`` gives the same road; the last one made is kept,
    for the runs of a comparison.
    """
    if road_class not in CLASSES:
        raise UnknownNameError("road class", road_class, CLASSES)
    count = 2 ** int(np.ceil(np.log2(max(length, 2 / LOWEST_FREQUENCY) / STEP)))
    frequencies = np.fft.rfftfreq(count, STEP)
    size = frequencies.size
    # there is nothing above the band, three quarters of the spectrum of a road
    frequency = frequencies[: np.searchsorted(frequencies, HIGHEST_FREQUENCY, "right")].copy()
    del frequencies
    density = np.zeros_like(frequency)
    band = frequency >= LOWEST_FREQUENCY
    density[band] = CLASSES[road_class] * (frequency[band] / REFERENCE_FREQUENCY) ** -2
    amplitude = np.sqrt(density * frequency[1] / 2) * count
    draw = np.random.default_rng(seed)
    first, second = (
        _spectrum(amplitude, draw.uniform(0.0, 2 * np.pi, size)[: frequency.size].copy())
        for _ in range(2)
    )
    coherence = 1 / (1 + (frequency * track) ** 2)
    second *= np.sqrt(1 - coherence**2)
    second += coherence * first
    points = round(length / STEP) + 1
    left, right = (np.fft.irfft(spectrum, count)[:points].copy() for spectrum in (first, second))
    eased = np.arange(min(points, round(10.0 / STEP))) * STEP / 10.0
    for profile in (left, right):
        profile[: eased.size] *= eased
    return left, right


def _spectrum(amplitude: Vector, phase: Vector) -> NDArray[np.complex128]:
    spectrum = np.asarray(1j * phase, np.complex128)
    np.exp(spectrum, out=spectrum)
    spectrum *= amplitude
    return spectrum


COLUMNS: Mapping[str, tuple[float, float]] = {
    "bank_deg": (-30.0, 30.0),
    "grade_deg": (-20.0, 20.0),
    "height_left": (-1.0, 1.0),
    "height_right": (-1.0, 1.0),
    "friction_left": (0.05, 1.5),
    "friction_right": (0.05, 1.5),
    "crosswind": (-60.0, 60.0),
    "speed_kmh": (5.0, 300.0),
}
"""Columns of a road's file over its column ``distance`` (m), with their ranges: degrees, heights in
m, friction in multiples of the option ``friction``, wind along the world's y axis in m/s, and the
speed to be driven."""
_PAIRS = {"road": ("height_left", "height_right"), "friction": ("friction_left", "friction_right")}
LONGEST = 100_000.0
"""Longest road of a file (m)."""


def on_road(plan: ManeuverPlan, file: str) -> ManeuverPlan:
    """Return the plan on the road of a file: its columns replace what the plan has of them.

    Between the rows values are linear, before the first and after the last they stay.

    Raises:
        UnknownNameError: a column that is none of :data:`COLUMNS`.
        CanrollError: an unreadable file, a number out of range, or one side without the other.
    """
    # the readers of logs, for a road from a file
    from canroll.plant_sim.driving import signal_file  # noqa: PLC0415

    given = {signal.name: signal for signal in signal_file.read_over(file, "distance", COLUMNS)}
    for name, signal in given.items():
        low, high = COLUMNS[name]
        outside = (signal.values < low) | (signal.values > high)
        if outside.any():
            value = signal.values[np.argmax(outside)]
            raise CanrollError(f"{file}: {name} {value:g}: must be {low:g} to {high:g}")
    for pair in _PAIRS.values():
        if len(set(pair) & set(given)) == 1:
            raise CanrollError(f"{file}: it needs both {' and '.join(pair)}")
    length = max(signal.times[-1] for signal in given.values())
    if not 0.0 < length <= LONGEST:
        raise CanrollError(f"{file}: a distance of {length:g} m: must end at 0 to {LONGEST:g} m")
    plan = _stepped(plan)
    at = np.arange(0.0, length + STEP, STEP)
    columns = {name: np.interp(at, signal.times, signal.values) for name, signal in given.items()}
    changes: dict[str, Vector | tuple[Vector, ...]] = {}
    for field, column in (("bank", "bank_deg"), ("grade", "grade_deg")):
        if column in columns:
            changes[field] = radians(1.0) * columns[column]
    for field, pair in _PAIRS.items():
        if pair[0] in columns:
            changes[field] = tuple(columns[name] for name in pair)
    if "crosswind" in columns:
        changes["wind"] = columns["crosswind"]
    if "speed_kmh" in columns:
        changes["speed"] = _over_time(columns["speed_kmh"] / 3.6, plan.duration)
    return replace(plan, **changes)  # type: ignore[arg-type]


def _stepped(plan: ManeuverPlan) -> ManeuverPlan:
    """Return the plan with steps of :data:`STEP` of distance."""
    if plan.road_step == STEP:
        return plan

    def finer(values: Vector) -> Vector:
        length = (len(values) - 1) * plan.road_step
        at = np.arange(0.0, length + STEP, STEP)
        fine: Vector = np.interp(at, plan.road_step * np.arange(len(values)), values)
        return fine

    changes: dict[str, Vector | tuple[Vector, ...]] = {}
    for field in ("bank", "grade", "road", "friction", "wind"):
        value = getattr(plan, field)
        if isinstance(value, tuple):
            changes[field] = tuple(map(finer, value))
        elif value is not None:
            changes[field] = finer(value)
    return replace(plan, road_step=STEP, **changes)  # type: ignore[arg-type]


def _over_time(speed: Vector, duration: float) -> Vector:
    """Return a speed over steps of distance (m/s) as one over steps of time, for that time (s)."""
    slowness = 1.0 / speed
    passed = np.append(0.0, np.cumsum(0.5 * STEP * (slowness[1:] + slowness[:-1])))
    at = np.arange(0.0, duration, STEP_NS * 1e-9)
    driven: Vector = np.interp(at, passed, speed)
    return driven
