"""The data of a design: gains, observer, delays, certificates, verdicts, provenance."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import islice
from math import inf
from typing import Any, NamedTuple

from canroll import dbc
from canroll.build_cache import key, sources
from canroll.firmware.com.signals import RX_IDS
from canroll.gain_gen.models.controller import LinearController
from canroll.gain_gen.models.observer import LateralModel, SensorNoise
from canroll.gain_gen.models.roll import Matrix
from canroll.vehicles import Vehicle
from canroll.vehicles.actuators import ACTUATORS

UNITS = {"db": "dB", "deg": "°", "s": "s", "nm": "N·m", "hz": "Hz"}
"""Unit of a check or number by the last word of its name."""
UNVERIFIED = "NOT VERIFIED"
"""Start of the warning that marks a design that is used although it is not verified."""
EPSILON_SQUARED = 0.1
"""Relative threshold of the event trigger, squared (Viadero 2022)."""
SOURCES = ("gain_gen", "firmware", "vehicles", "dbc", "codegen")
SOLVERS = ("numpy", "scipy", "cvxpy", "clarabel")


PERIODS = tuple(dbc.period(dbc.load().get_message_by_frame_id(number).name) for number in RX_IDS)
"""Cycle times of the received messages of ``roll_control.dbc``, in the order of mailboxes, s."""


def made_of(*parts: object) -> bytes:
    """Return all that a design depends on: our sources, the solvers, and ``parts``, plain data."""
    return sources(*SOURCES, packages=SOLVERS) + key(*parts)


class Check(NamedTuple):
    """One check: value, limit, whether it passes, and where the value was found, if known."""

    value: float
    limit: float
    ok: bool
    where: str = ""


def below(value: float, limit: float, where: str = "") -> Check:
    """Return the check that ``value`` is less than ``limit``; not-a-number fails."""
    return Check(float(value), float(limit), bool(value < limit), where)


def above(value: float, limit: float, where: str = "") -> Check:
    """Return the check that ``value`` is more than ``limit``; not-a-number fails."""
    return Check(float(value), float(limit), bool(value > limit), where)


def in_words(name: str, check: Check) -> str:
    """Return a check in words: its value, its limit, and where the value was found."""
    words = name.split("_")
    unit = f" {UNITS[words.pop()]}" if words[-1] in UNITS else ""
    where = f" ({check.where})" if check.where else ""
    return f"{' '.join(words)} is {check.value:.3g}{unit} against {check.limit:g}{unit}{where}"


@dataclass(frozen=True, slots=True)
class Delay:
    """Sample-to-force delay: nominal value of the design and its bounds, s."""

    nominal: float
    least: float
    most: float

    @classmethod
    def constant(cls, seconds: float) -> "Delay":
        """Return a constant delay."""
        return cls(seconds, seconds, seconds)


@dataclass(frozen=True, slots=True)
class Resolution:
    """Steps of the signals on the bus; 0 where it has none.

    Attributes:
        roll_rate: rad/s.
        lateral_acceleration: m/s².
        steering: of the steering wheel, rad.
        delivered: reported moment of an axle, N·m.
        bar: commanded moment of an axle, N·m.
        force: commanded force of a corner, N.
    """

    roll_rate: float
    lateral_acceleration: float
    steering: float
    delivered: float
    bar: float
    force: float


@dataclass(frozen=True, slots=True)
class Task:
    """Input of a law.

    Attributes:
        vehicle: design model, actuators and sensors.
        delay: from the sample to the force.
        tick: period of the ECU loop, s.
        actuator: name in :data:`canroll.vehicles.actuators.ACTUATORS`.
        observer: name of the observer settings.
        feedforward: whether the disturbance feedforward is on.
        gains: "computed", "theorem" (of the paper, on its 1-DOF model) or "as_printed".
        lateral: model of the lateral acceleration.
        noise: noise of the sensors.
        matrices: file of a custom law, or its matrices by name; empty: none.
        order: order of a reduced compensator.
        gamma_target: H∞ level to certify, or zero for the least.
        moment_share: RMS moment over the RMS of the roll moment m h a_y, or None for the law's own.
        unverified: whether a design that fails a check is returned, marked, instead of refused.
        resolution: of the bus; None for that of ``roll_control.dbc``.
        periods: cycle times of the received messages, in the order of the mailboxes, s.
    """

    vehicle: Vehicle
    delay: Delay
    tick: float = 0.01
    actuator: str = "suspension"
    observer: str = "two_sensors"
    feedforward: bool = True
    gains: str = "computed"
    lateral: LateralModel = field(default_factory=LateralModel)
    noise: SensorNoise = field(default_factory=SensorNoise)
    matrices: str | Mapping[str, Any] = ""
    order: int = 4
    gamma_target: float = 0.0
    moment_share: float | None = None
    unverified: bool = False
    resolution: Resolution | None = None
    periods: tuple[float, ...] = PERIODS

    def sample(self, message: int) -> float:
        """Return the time between two samples of a received message that the loop sees, s."""
        return max(self.periods[message], self.tick)

    @property
    def lag(self) -> float:
        """Time constant of the actuator, s."""
        return ACTUATORS[self.actuator].lag(self.vehicle)


@dataclass(frozen=True, slots=True)
class Solution:
    """Output of a law: a controller and its certificates.

    Attributes:
        controller: gains in SI units.
        gamma: H∞ level by exact analysis, or None if the law has no such objective.
        gamma_bound: level certified by the solver's point, or None.
        gamma_channel: from what to what these levels are, with units; they compare only within it.
        checks: checks specific to this law.
        rightmost_root: largest real part of the continuous delay loop's roots, or None.
        max_delay: largest constant delay of the continuous loop, s, or None: from the sampled loop.
        delay_aware: False for a delay-unaware law.
        solve_seconds: time in solvers, s.
        notes: remarks for the user, one line each.
        extra: further numbers to report by name.
        verified_by_law: the law is designed on another plant than the 1-DOF one and checks itself.
        given: the user's matrices by name, as in the file.
    """

    controller: LinearController
    gamma: float | None = None
    gamma_bound: float | None = None
    gamma_channel: str = ""
    checks: Mapping[str, Check] = field(default_factory=dict)
    rightmost_root: float | None = None
    max_delay: float | None = None
    delay_aware: bool = False
    solve_seconds: float = 0.0
    notes: tuple[str, ...] = ()
    extra: Mapping[str, float] = field(default_factory=dict)
    verified_by_law: bool = False
    given: Mapping[str, Matrix] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, repr=False)
class Design:
    """A law for a vehicle, verified.

    Attributes:
        law: its name.
        task: the task it was designed for.
        solution: the law's answer.
        margins: margins and analysed numbers by name, SI units unless the name says otherwise.
        verified: every check by name.
        warnings: one line each.
    """

    law: str
    task: Task
    solution: Solution
    margins: Mapping[str, float]
    verified: Mapping[str, Check]
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        verdict = "; ".join(self.failed) or ("verified" if self.is_verified else UNVERIFIED)
        figures = ", ".join(in_words(*each) for each in islice(self.verified.items(), 3))
        return f"<{self.law} for {self.task.vehicle.name}: {verdict}; {figures}>"

    @property
    def controller(self) -> LinearController:
        """The gains, SI units."""
        return self.solution.controller

    @property
    def is_verified(self) -> bool:
        """Whether every check holds."""
        return bool(self.verified) and not self.failures

    @property
    def failures(self) -> dict[str, Check]:
        """The checks that do not hold."""
        return {name: check for name, check in self.verified.items() if not check.ok}

    @property
    def failed(self) -> list[str]:
        """The checks that do not hold, in words."""
        return [in_words(name, check) for name, check in self.failures.items()]

    @property
    def max_delay(self) -> float:
        """Largest admissible constant delay, s: the lesser of exact and sampled analysis."""
        return min(
            self.margins.get("max_delay_s", inf), self.margins.get("max_delay_sampled_s", inf)
        )
