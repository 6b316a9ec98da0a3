"""Road surfaces: bumps, and random roads after ISO 8608 with two correlated wheel tracks."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from canroll.errors import UnknownNameError
from canroll.typing import Vector

STEP = 0.05
"""Distance between the points of a road profile (m)."""

CLASSES = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6}
"""Displacement power spectral density at 0.1 cycles/m (m³), ISO 8608 table C.1, geometric mean."""

REFERENCE_FREQUENCY = 0.1
LOWEST_FREQUENCY = 0.011
HIGHEST_FREQUENCY = 2.83


def bumps(*, height: float, length: float, spacing: float, count: int, start: float) -> Vector:
    """Cosine bumps of ``height`` over ``length``, the first at ``start`` (all m)."""
    s = np.arange(0.0, start + count * spacing + 2 * length, STEP)
    profile = np.zeros_like(s)
    for i in range(count):
        part = (s - start - i * spacing) / length
        inside = (part > 0) & (part < 1)
        profile[inside] = 0.5 * height * (1 - np.cos(2 * np.pi * part[inside]))
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
