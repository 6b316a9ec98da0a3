"""A bank of residuals in SI units: parts, residuals, signatures.

A part is a filtered combination of at most two signals, a residual a signed sum of parts, its
threshold a weighted sum of their magnitudes and a floor, a signature the residuals that one fault
raises. The firmware runs such a bank (:mod:`firmware.monitors.residuals`).
"""

from dataclasses import dataclass
from math import ceil, inf, pi

DIRECT, INTEGRAL, DERIVATIVE, STEP = "direct", "integral", "derivative", "step"
KINDS = (DIRECT, INTEGRAL, DERIVATIVE, STEP)
"""Kinds of parts in the firmware's order; "step" is the mean magnitude of a signal's steps."""
SIGNALS = (
    *("stroke_front", "stroke_rear", "heave_front", "heave_rear", "moment_front", "moment_rear"),
    *("lateral", "turning", "steered", "roll_rate", "yaw_rate", "gyro_bias"),
)
"""Inputs in the firmware's order: left − right and left + right stroke rates (m/s), delivered
moments (N·m), lateral acceleration as measured, as yaw rate × speed and as steering and speed give
it (m/s²), roll rate, yaw rate, the observer's gyro bias (rad/s)."""
MEAN = 10.0
"""Time over which the mean magnitude of steps is taken, s."""


@dataclass(frozen=True, slots=True)
class Part:
    """A filtered signal in N·m.

    Attributes:
        name: in words.
        kind: one of :data:`KINDS`.
        gains: by signal; N·m per unit, of an integral per s.
        washout: corner of the washout, Hz; 0: none.
        low_pass: time constant of the low-pass, s; of a derivative of what is subtracted.
    """

    name: str
    kind: str
    gains: dict[str, float]
    washout: float = 0.0
    low_pass: float = 0.05

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
        bit: name of its bit in signatures; several may share one.
        terms: its terms; those of sign 0 occur in the threshold alone.
        floor: of the threshold, N·m.
        time: without a break beyond the threshold before it is raised, s.
        hold: time constant with which its threshold fades, s: for so long the filter remembers what
            no share of its parts says.
        ranges: of :class:`Ranges`, in which it is judged.
    """

    name: str
    bit: str
    terms: tuple[Term, ...]
    floor: float
    time: float
    hold: float = 0.4
    ranges: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Signature:
    """A pattern of raised residuals.

    Attributes:
        name: the fault.
        same: bits raised to one side.
        opposite: bits raised to the other.
        absent: bits that are not raised to the first side.
        wrong: what is not trusted any more: "lateral", "rate", "front", "rear".
        hazard: the harm that it prevents, and how.
        time: how long the pattern is seen before it counts, s; 0: at once.
    """

    name: str
    same: tuple[str, ...]
    wrong: tuple[str, ...]
    hazard: str
    opposite: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    time: float = 0.0


@dataclass(frozen=True, slots=True)
class Ranges:
    """Where residuals are judged, by the peak of yaw rate × speed and of steering, m/s².

    Attributes:
        linear: below it tyres are linear.
        on_road: below it all wheels are on the road.
        off_stops: below it no body of the box leans on its bump stops.
        lean: name of the part that says how far the body leans; empty: there is none.
        lean_max: beyond it the body leans on its stops, N·m: it does until it is below
            ``off_stops``.
    """

    linear: float
    on_road: float
    off_stops: float
    lean: str = ""
    lean_max: float = 0.0


@dataclass(frozen=True, slots=True)
class Bank:
    """Parts by name, residuals and signatures of one car; ``tick`` is that of a round, s."""

    parts: dict[str, Part]
    residuals: tuple[Residual, ...]
    signatures: tuple[Signature, ...]
    ranges: Ranges
    tick: float

    def rounds(self, time: float) -> int:
        """Return for how many rounds a residual of ``time`` (s) is beyond its threshold."""
        return rounds(time, self.tick)


def rounds(time: float, tick: float) -> int:
    """Return the least number of rounds of ``tick`` s that last ``time`` s, at least two."""
    return max(2, ceil(time / tick - 1e-6))
