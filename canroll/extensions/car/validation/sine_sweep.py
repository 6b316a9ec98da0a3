"""A sine sweep (ISO 7401): frequency responses of measured and simulated car to the steering."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.signal import coherence, csd, welch

from canroll.errors import CanrollError
from canroll.extensions.car.identification.pieces import SAMPLE
from canroll.extensions.car.validation.criterion import GAINS, Criterion, Judged, ToleranceBand
from canroll.extensions.car.validation.replayed import Drive
from canroll.extensions.car.validation.tolerances import FACTORS, Tolerance
from canroll.typing import Vector

FREQUENCIES = (0.5, 1.0, 1.5, 2.0)
"""Frequencies (Hz) whose gains and phases are listed, where both coherences are enough."""
LEAST, MOST = 0.2, 3.0
"""Range (Hz) whose gains are judged: above, the filter shapes both."""
SEGMENT = 4.0
"""Length (s) of a segment of Welch's method."""
COHERENT = 0.95


def judge(drive: Drive, tolerances: Mapping[str, Tolerance]) -> Judged:
    """Compare gains and phases.

    Raises:
        CanrollError: no frequency at which the log tells a response.
    """
    stretch = max(drive.stretches, key=lambda stretch: int(stretch.inside.sum()))
    there = stretch.inside.copy()
    for name in GAINS:
        if name in drive.names:
            there &= np.isfinite(stretch.measured[name])
    steering = stretch.steering[there]
    criteria: list[Criterion] = []
    bands: list[ToleranceBand] = []
    for name, (label, unit, factor) in GAINS.items():
        if name not in drive.names:
            continue
        both = [
            response(steering, factor * signals[name][there])
            for signals in (stretch.measured, stretch.simulated)
        ]
        criteria += _criteria(label, unit, both, tolerances)
        bands.append(_gain_band(name, label, unit, both, tolerances["gain"]))
    if not criteria:
        raise CanrollError(
            f"{drive.log}: no frequency of {', '.join(f'{f:g}' for f in FREQUENCIES)} Hz at which "
            "steering and motion are coherent: choose another --manoeuvre"
        )
    return Judged(tuple(criteria), tuple(bands))


def response(steering: Vector, signal: Vector) -> tuple[Vector, NDArray[np.complex128], Vector]:
    """Return frequencies (Hz), response and coherence, by Welch's method."""
    # of one segment alone everything is coherent
    count = min(round(SEGMENT / SAMPLE), len(steering) // 4)
    frequency, power = welch(steering, fs=1.0 / SAMPLE, nperseg=count)
    _, cross = csd(steering, signal, fs=1.0 / SAMPLE, nperseg=count)
    _, coherent = coherence(steering, signal, fs=1.0 / SAMPLE, nperseg=count)
    return frequency, cross / np.maximum(power, 1e-300), np.nan_to_num(coherent)


def _criteria(
    label: str,
    unit: str,
    both: list[tuple[Vector, NDArray[np.complex128], Vector]],
    tolerances: Mapping[str, Tolerance],
) -> Iterator[Criterion]:
    (frequency, measured, coherent), (_, simulated, coherent_simulated) = both
    for wanted in FREQUENCIES:
        k = int(np.argmin(np.abs(frequency - wanted)))
        if min(coherent[k], coherent_simulated[k]) < COHERENT:
            continue
        gain = float(abs(measured[k]))
        yield Criterion(
            f"{label} at {wanted:g} Hz, gain",
            gain,
            float(abs(simulated[k])),
            unit,
            tolerances["gain"].of(gain),
        )
        phase = float(np.angle(measured[k]))
        other = phase + float(np.angle(simulated[k] / measured[k]))
        allowed = tolerances["phase"].of(phase) / FACTORS["°"]
        yield Criterion(
            f"{label} at {wanted:g} Hz, phase",
            float(np.degrees(phase)),
            float(np.degrees(other)),
            "°",
            allowed,
        )


def _gain_band(
    name: str,
    label: str,
    unit: str,
    both: list[tuple[Vector, NDArray[np.complex128], Vector]],
    tolerance: Tolerance,
) -> ToleranceBand:
    (frequency, measured, coherent), (_, simulated, _) = both
    shown = (frequency >= LEAST) & (frequency <= MOST) & (coherent >= COHERENT)
    at, real, ours = frequency[shown], np.abs(measured[shown]), np.abs(simulated[shown])
    allowed = tolerance.along(real)
    far = np.abs(ours - real) / np.maximum(allowed, 1e-12)
    worst = int(np.argmax(far)) if at.size else 0
    return ToleranceBand(
        name,
        f"Gain of {label}",
        "frequency (Hz)",
        unit,
        (at, real),
        (at, ours),
        (at, ours - allowed),
        (at, ours + allowed),
        float(far[worst]) if at.size else 0.0,
        float(at[worst]) if at.size else 0.0,
    )
