"""A vehicle validated by a measured drive: every signal, and the figures of the manoeuvre."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np

from canroll.errors import CanrollError, UnknownNameError
from canroll.extensions.car.identification.drive_log import MOTION, OUTPUTS, Log
from canroll.extensions.car.identification.moments import moments
from canroll.extensions.car.identification.pieces import EVERYTHING, SAMPLE, Window
from canroll.extensions.car.validation import sine_sweep, sine_with_dwell, steady_circle, step_steer
from canroll.extensions.car.validation.criterion import Judged
from canroll.extensions.car.validation.manoeuvre import (
    FREE,
    MANOEUVRES,
    SINE_SWEEP,
    SINE_WITH_DWELL,
    STEADY_CIRCLE,
    STEP_STEER,
    WORDS,
    recognised,
)
from canroll.extensions.car.validation.measurement import NONE, Measurement
from canroll.extensions.car.validation.rating import Rating, rate_drive
from canroll.extensions.car.validation.replayed import Drive, label, replayed
from canroll.extensions.car.validation.tolerances import TOLERANCES, Tolerance
from canroll.table import Table
from canroll.vehicles import Vehicle

RATING = 0.80
"""Rating of ISO/TS 18571 above which it calls an agreement good."""
EXPLAINED: Mapping[str, float] = {
    **dict.fromkeys(OUTPUTS, 0.94),
    "yaw_rate": 0.995,
    "lateral_acceleration": 0.98,
    "roll_rate": 0.93,
}
"""Share of a signal's variance that must be accounted for: what the 14-DOF car reaches for a
measured one, see docs/trust.md."""

JUDGES = {
    STEADY_CIRCLE: steady_circle.judge,
    STEP_STEER: step_steer.judge,
    SINE_SWEEP: sine_sweep.judge,
    SINE_WITH_DWELL: sine_with_dwell.judge,
}
"""What compares the figures of a manoeuvre; free driving has none."""


@dataclass(frozen=True, slots=True)
class ValidationSettings:
    """How a log is compared, and what is enough.

    Attributes:
        imu: axes of the inertial unit, a key of ``replay.FRAMES``.
        window: part of the log.
        manoeuvre: one of ``manoeuvre.MANOEUVRES``; "": recognised.
        rating: least overall rating of a signal.
        explained: least share of the variance of each signal that is accounted for.
        error: largest RMS of the difference over the largest measured value.
        tolerances: of the figures of manoeuvres.
    """

    imu: str = "body"
    window: Window = EVERYTHING
    manoeuvre: str = ""
    rating: float = RATING
    explained: Mapping[str, float] = field(default_factory=lambda: dict(EXPLAINED))
    error: float = np.inf
    tolerances: Mapping[str, Tolerance] = field(default_factory=lambda: dict(TOLERANCES))

    def __post_init__(self) -> None:
        """Refuse what nothing can be measured by."""
        if self.manoeuvre and self.manoeuvre not in MANOEUVRES:
            raise UnknownNameError("manoeuvre of a log", self.manoeuvre, MANOEUVRES)
        if not 0.0 <= self.rating <= 1.0:
            raise CanrollError(f"--rating {self.rating:g}: must be 0 to 1")
        if not self.error > 0.0:
            raise CanrollError(f"--error {self.error:g}: must be above 0")


@dataclass(frozen=True, slots=True)
class Match:
    """A simulated signal against the measured one.

    Attributes:
        name: of the signal.
        explained: variance accounted for, 1 − var(difference)/var(measured).
        rms: of the difference (SI units).
        error: ``rms`` over the largest measured value.
        rating: of ISO/TS 18571; None where nothing was rated.
        rated: seconds that were rated.
        failed: what is not enough, in words; empty if all is.
    """

    name: str
    explained: float
    rms: float
    error: float
    rating: Rating | None
    rated: float
    failed: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Validation:
    """The verdict of a log on a vehicle.

    ``seconds`` were compared; ``named``: the manoeuvre was given, not recognised.
    """

    drive: Drive
    manoeuvre: str
    named: bool
    seconds: float
    matches: tuple[Match, ...]
    judged: Judged
    measurement: Measurement

    @property
    def passed(self) -> bool:
        """Whether all signals and figures are good enough."""
        return self.judged.passed and not any(match.failed for match in self.matches)

    @property
    def unjudged(self) -> tuple[str, ...]:
        """What of a car's motion the log does not have: roll is in its rate or its angle."""
        names = self.drive.names
        missing = (name for name in MOTION if name not in names)
        return tuple(label(name) for name in missing if name.removesuffix("_rate") not in names)

    @property
    def verdict(self) -> str:
        """The answer in a line."""
        about = f"{self.seconds:.1f} s of {self.drive.log}, "
        about += WORDS[self.manoeuvre].partition(" (")[0]
        if self.unjudged:
            judged = " and ".join(label(name) for name in self.drive.names)
            about += f", judged by {judged}, not by {' and '.join(self.unjudged)}"
        name = self.drive.vehicle.name
        if self.passed:
            return f"{name} moves as measured: {about}"
        return f"{name} does not move as measured: {about}: {self.failures[0]}"

    @property
    def table(self) -> Table:
        """One row for each signal: variance explained, rating, error, and what failed."""
        return Table(
            [
                {
                    "signal": match.name,
                    "explained": match.explained,
                    "rating": None if match.rating is None else match.rating.overall,
                    "rms": match.rms,
                    "error": match.error,
                    "failed": ", ".join(match.failed),
                }
                for match in self.matches
            ]
        )

    def __repr__(self) -> str:
        return f"<{self.verdict}>"

    @property
    def failures(self) -> tuple[str, ...]:
        """What is not good enough, in words."""
        figures = tuple(
            f"{one.label} {one.simulated:.3g} instead of {one.measured:.3g} {one.unit}"
            for one in self.judged.criteria
            if not one.passed
        )
        bands = tuple(
            f"{band.title}: {band.worst:.2g} times the tolerance at {band.at:.3g}"
            for band in self.judged.bands
            if not band.passed
        )
        signals = tuple(
            f"{label(match.name)}: {text}" for match in self.matches for text in match.failed
        )
        return signals + figures + bands

    def to_json(self) -> dict[str, Any]:
        """Return the verdict as plain data; SI units, figures in theirs."""
        return {
            "log": self.drive.log,
            "manoeuvre": self.manoeuvre,
            "named": self.named,
            "seconds": self.seconds,
            "passed": self.passed,
            "failures": list(self.failures),
            "not_judged": list(self.unjudged),
            "signals": [
                asdict(match)
                | {
                    "explained": match.explained if isfinite(match.explained) else None,
                    "error": match.error if isfinite(match.error) else None,
                    "grade": None if match.rating is None else match.rating.grade,
                }
                for match in self.matches
            ],
            "figures": [
                asdict(one)
                | {
                    "passed": one.passed,
                    "tolerance": one.tolerance if isfinite(one.tolerance) else None,
                }
                for one in self.judged.criteria
            ],
            "bands": [band.to_json() for band in self.judged.bands],
            "steering_offset": self.measurement.steering_offset,
            "offsets": dict(self.measurement.offsets),
            "delays": dict(self.measurement.delays),
            "remarks": list(self.drive.remarks),
        }


def validate(
    log: Log, vehicle: Vehicle, settings: ValidationSettings, measurement: Measurement = NONE
) -> Validation:
    """Judge a vehicle by a log.

    Args:
        log: the measured drive.
        vehicle: the car that is steered as measured.
        settings: how, and what is enough.
        measurement: offsets and delays of the log.

    Raises:
        CanrollError: the log cannot be used, or is not the named manoeuvre.
        VerdictError: the simulated car rolls over.
    """
    moved = moments(log, vehicle, window=settings.window)
    drive = replayed(moved.log, vehicle, settings.window, settings.imu, measurement)
    drive = replace(drive, remarks=(*drive.remarks, *moved.remarks))
    kind = settings.manoeuvre or recognised(drive)
    matches = tuple(_match(drive, name, kind, settings) for name in drive.names)
    judged = JUDGES[kind](drive, settings.tolerances) if kind != FREE else Judged()
    seconds = sum(float(stretch.inside.sum()) for stretch in drive.stretches) * SAMPLE
    return Validation(drive, kind, bool(settings.manoeuvre), seconds, matches, judged, measurement)


def _match(drive: Drive, name: str, kind: str, settings: ValidationSettings) -> Match:
    measured, simulated = drive.joined(name)
    if not measured.size:
        raise CanrollError(f"{drive.log}: no {label(name)} in what is compared")
    difference = simulated - measured
    variance, largest = float(np.var(measured)), float(np.abs(measured).max())
    explained = 1.0 - float(np.var(difference)) / variance if variance > 0.0 else float("nan")
    rms = float(np.sqrt(np.mean(difference**2)))
    error = rms / largest if largest > 0.0 else float("inf")
    # on a steady circle signals hardly change: their bands say what matters
    if kind == STEADY_CIRCLE:
        return Match(name, explained, rms, error, None, 0.0, ())
    rating, rated = rate_drive(drive, name)
    failed = []
    least = settings.explained[name]
    if not explained >= least:
        failed.append(f"VAF {100 * explained:.2f} %, {100 * least:.4g} % required")
    if rating is not None and not rating.overall > settings.rating:
        failed.append(f"rating {rating.overall:.3f}, above {settings.rating:g} required")
    if not error <= settings.error:
        failed.append(
            f"error {100 * error:.3g} % of the largest value, at most "
            f"{100 * settings.error:.3g} % allowed"
        )
    return Match(name, explained, rms, error, rating, rated, tuple(failed))
