"""A bank of residuals in SI units: parts and residuals.

A part is a filtered combination of at most two signals, a residual a signed sum of parts, its
threshold a weighted sum of their magnitudes and a floor (parity relations with adaptive thresholds:
Chow and Willsky 1984, Gertler 1998).
"""

from dataclasses import dataclass
from math import ceil, inf, log2, pi, pow

from canroll.firmware import calibration as fw
from canroll.vehicles import Vehicle

DIRECT, INTEGRAL, DERIVATIVE, STEP = "direct", "integral", "derivative", "step"
"""Kinds of parts; "step" is the mean magnitude of a signal's steps."""
SIGNALS = (
    *("stroke_front", "stroke_rear", "heave_front", "heave_rear", "moment_front", "moment_rear"),
    *("lateral", "turning", "steered", "roll_rate", "yaw_rate"),
)
"""Measured signals: left − right and left + right stroke rates (m/s), delivered
moments (N·m), lateral acceleration as measured, as yaw rate × speed and as steering and speed give
it (m/s²), roll rate, yaw rate (rad/s)."""
LOW_PASS = 0.05
"""Time constant of the low-pass, s; that by the suspensions is longer for a heavy body."""
LARGEST = fw.STATE_MAX * 2.0**-fw.Q_MOMENT
"""The format's largest moment, N·m."""
RESPONSE_LINEAR = 10.0
"""Lateral acceleration by yaw rate or steering, m/s², beyond which wheels lift and stops are
reached."""
FADING = 8.0
"""Time constants of the low-pass in which a threshold fades, where a residual says nothing else."""
MEAN = 10.24
"""Time over which the mean magnitude of steps is taken, s."""
TRUST = 2.0**-11
"""By which the largest motion fades in 10 ms to tell whether the tyres are linear: in 20 s."""


@dataclass(frozen=True, slots=True)
class ResidualPart:
    """A filtered signal in N·m.

    Attributes:
        name: in words.
        kind: how: :data:`DIRECT`, ``INTEGRAL``, ``DERIVATIVE`` or ``STEP``.
        gains: by signal; N·m per unit, of an integral per s.
        washout: corner of the washout, Hz; 0: none.
        low_pass: time constant of the low-pass, s; of a derivative of what is subtracted.
    """

    name: str
    kind: str
    gains: dict[str, float]
    washout: float = 0.0
    low_pass: float = LOW_PASS

    def memory(self, tick: float) -> float:
        """Return the washout's time constant in ticks; infinite without one."""
        return 1.0 / (2.0 * pi * self.washout * tick) if self.washout else inf


@dataclass(frozen=True, slots=True)
class Term:
    """A part in a residual: its sign there, and the share of its size by which that is wrong."""

    part: str
    sign: int
    weight: float


@dataclass(frozen=True, slots=True)
class Residual:
    """A residual.

    Attributes:
        name: in words.
        terms: its terms; those of sign 0 occur in the threshold alone.
        floor: of the threshold, N·m.
        time: without a break beyond the threshold before it is raised, s.
        limit: largest lateral acceleration by yaw rate or steering at which it holds, m/s².
        fading: time constant with which the terms' share of the threshold fades, s.
        noisy: what noise alone adds to the threshold by its terms, N·m.
    """

    name: str
    terms: tuple[Term, ...]
    floor: float
    time: float
    limit: float = inf
    fading: float = FADING * LOW_PASS
    noisy: float = 0.0


@dataclass(frozen=True, slots=True)
class Bank:
    """Parts by name and residuals of one car at one ``tick`` (s)."""

    parts: dict[str, ResidualPart]
    residuals: tuple[Residual, ...]
    tick: float


def weight(of_10_ms: float, period: float) -> float:
    """Return the weight per sample, every ``period`` s, of a low-pass by that for 10 ms."""
    return 1.0 - pow(1.0 - of_10_ms, period / 0.01)


def ticks_of(time: float, tick: float) -> int:
    """Return the least number of ticks that last ``time`` s, at least two."""
    return max(2, ceil(time / tick - 1e-6))


def low_pass_of(vehicle: Vehicle) -> float:
    """Return the time constant of a car's low-pass: doubled until its momentum over that fits.

    The largest momentum is that of a body that swings, at its natural frequency, by the steady roll
    at :data:`RESPONSE_LINEAR`. Over the inverse of that frequency it is the moment of that lateral
    acceleration: where this fits, the time constant is at most two of the inverse.
    """
    roll = vehicle.design
    swing = roll.natural_frequency * roll.roll_arm * RESPONSE_LINEAR / roll.effective_stiffness
    return LOW_PASS * 2.0 ** max(0, ceil(log2(roll.roll_inertia * swing / LOW_PASS / LARGEST)))
