"""Detectability by the residuals of a car: least size of each fault, and which are separable."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, pi
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.signal import lsim

from canroll.firmware.calibration import Calibration
from canroll.firmware.state import RX_ACTUATOR_STATE, RX_SUSPENSION_RATE
from canroll.gain_gen.models.task import Task
from canroll.gain_gen.monitors.bank import Bank, Residual, ticks_of
from canroll.gain_gen.monitors.evaluation import moved, room
from canroll.gain_gen.monitors.linear_car import car_of, effective_inertia
from canroll.gain_gen.monitors.residuals import bank_of
from canroll.gain_gen.monitors.uncertainty import DEFAULT, NOMINAL, Uncertainty
from canroll.vehicles import GRAVITY, Vehicle

TOLERATED = 0.3
"""Time after its beginning in which a fault is to be found, s."""
SLALOM = 4.0, 0.4
"""Lateral acceleration, m/s², and frequency, Hz, of the slalom that bounds are evaluated in."""
SECONDS = 8.0
Raised = tuple[str, int]
"""A residual and the side to which it is raised."""
LEAST_SHARE = 0.01
"""Share of a fault's effect on a residual that its effect on the threshold must leave."""


@dataclass(frozen=True, slots=True)
class ConstantFault:
    """A constant fault: what a unit of it adds to signals; a moment is reported too large."""

    name: str
    unit: str
    signals: Mapping[str, float]


FAULTS = (
    ConstantFault("moment of the front axle", "N·m", {"moment_front": 1.0}),
    ConstantFault("moment of the rear axle", "N·m", {"moment_rear": 1.0}),
    ConstantFault("lateral acceleration", "m/s²", {"lateral": 1.0}),
    ConstantFault("roll rate", "rad/s", {"roll_rate": 1.0}),
    ConstantFault("front stroke rate", "m/s", {"stroke_front": 1.0}),
    ConstantFault("rear stroke rate", "m/s", {"stroke_rear": 1.0}),
    ConstantFault("rear stroke rates, both alike", "m/s", {"heave_rear": 1.0}),
)


@dataclass(frozen=True, slots=True)
class Limit:
    """Least size of a fault that raises a residual within :data:`TOLERATED`.

    Attributes:
        residual: name of the residual.
        side: of the residual, for a positive fault.
        straight: least size on a straight, even road.
        slalom: least size at the worst moment of :data:`SLALOM`.
    """

    residual: str
    side: int
    straight: float
    slalom: float


@dataclass(frozen=True, slots=True)
class Detectable:
    """What of a fault can be found.

    Attributes:
        fault: which.
        limits: by residual that sees it; none: it is undetectable.
        isolated: least size in the slalom at which no other fault raises the same residuals to the
            same sides, but for those of ``inseparable``; infinite: none.
        inseparable: names of the faults that it is always confused with.
    """

    fault: ConstantFault
    limits: tuple[Limit, ...]
    isolated: float
    inseparable: tuple[str, ...]

    @property
    def straight(self) -> float:
        """Least size that any residual finds on a straight, even road; infinite: none does."""
        return min((limit.straight for limit in self.limits), default=inf)

    @property
    def slalom(self) -> float:
        """Least size that any residual finds in the slalom; infinite: none does."""
        return min((limit.slalom for limit in self.limits), default=inf)

    @property
    def first(self) -> str:
        """Name of the residual that finds the least in the slalom; empty: none does."""
        return min(self.limits, key=lambda limit: limit.slalom).residual if self.limits else ""

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data; sizes that are infinite are None."""
        sizes = {"straight": self.straight, "slalom": self.slalom, "told_apart": self.isolated}
        return {
            "fault": self.fault.name,
            "unit": self.fault.unit,
            **{name: size if isfinite(size) else None for name, size in sizes.items()},
            "residual": self.first,
            "inseparable": list(self.inseparable),
        }


def bank_of_calibration(record: Calibration, task: Task, box: Uncertainty = DEFAULT) -> Bank:
    """Return the residuals of the signals that the loop of a calibration waits for."""
    waits = record.timeout_ticks
    moments = task.actuator in ("suspension", "bars") and waits[RX_ACTUATOR_STATE] > 0
    return bank_of(task, box, suspension=waits[RX_SUSPENSION_RATE] > 0, moments=moments)


def of_calibration(
    record: Calibration, task: Task, box: Uncertainty = DEFAULT
) -> tuple[Detectable, ...]:
    """Return what can be found with the signals that the loop of a calibration waits for."""
    return detectable(bank_of_calibration(record, task, box), task.vehicle)


def detectable(bank: Bank, vehicle: Vehicle) -> tuple[Detectable, ...]:
    """Return what can be found of each fault of a signal that is in a residual."""
    driven = slalom(vehicle, bank.tick)
    settled = round(0.5 * SECONDS / bank.tick)
    largest = {
        r.name: float(room(bank, r, driven)[settled:].max()) if SLALOM[0] <= r.limit else inf
        for r in bank.residuals
    }
    measured = {name for part in bank.parts.values() for name in part.gains}
    limits = {
        fault.name: _limits(bank, fault, largest)
        for fault in FAULTS
        if measured.intersection(fault.signals)
    }
    return tuple(
        Detectable(
            fault,
            limits[fault.name],
            isolated(fault.name, limits),
            inseparable(fault.name, limits),
        )
        for fault in FAULTS
        if fault.name in limits
    )


def _limits(bank: Bank, fault: ConstantFault, largest: Mapping[str, float]) -> tuple[Limit, ...]:
    """Return the limits of a fault by residual."""
    limits = []
    for residual in bank.residuals:
        side, net = effect(bank, residual, fault)
        if side:
            least = residual.floor + residual.noisy
            sizes = least / net, (least + largest[residual.name]) / net
            limits.append(Limit(residual.name, side, *sizes))
    return tuple(limits)


def inseparable(fault: str, limits: Mapping[str, Sequence[Limit]]) -> tuple[str, ...]:
    """Return the faults that raise the same residuals as a fault, however large both are."""
    signatures = {name: _signature(of_fault) for name, of_fault in limits.items()}
    return tuple(
        name
        for name, signature in signatures.items()
        if name != fault and signature & signatures[fault]
    )


def isolated(fault: str, limits: Mapping[str, Sequence[Limit]]) -> float:
    """Return the least size in the slalom at which only what is inseparable raises the same."""
    passed = {fault, *inseparable(fault, limits)}
    of_others: set[frozenset[Raised]] = set()
    for other, of_other in limits.items():
        if other not in passed:
            for count in range(len(of_other)):
                of_others |= _signature(_ordered(of_other)[: count + 1])
    ordered = _ordered(limits[fault])
    sizes = (
        last.slalom
        for count, last in enumerate(ordered)
        if not _signature(ordered[: count + 1]) & of_others
    )
    return min(sizes, default=inf)


def _ordered(limits: Sequence[Limit]) -> list[Limit]:
    return sorted(limits, key=lambda limit: limit.slalom)


def _signature(limits: Sequence[Limit]) -> set[frozenset[Raised]]:
    """Return the residuals with the sides to which a fault raises them, of either sign."""
    return {
        frozenset((limit.residual, sign * limit.side) for limit in limits)
        for sign in (1, -1)
        if limits
    }


def effect(bank: Bank, residual: Residual, fault: ConstantFault) -> tuple[int, float]:
    """Return to which side a unit of a fault moves a residual, and how far beyond its threshold.

    The least while it counts, in the best time within :data:`TOLERATED`, in N·m per unit: what is
    washed out has been seen by then. 0: the threshold grows as much.
    """
    ticks = max(2, round(TOLERATED / bank.tick))
    counted = min(ticks, ticks_of(residual.time, bank.tick))
    signals = {name: np.full(ticks, value) for name, value in fault.signals.items()}
    total, size = moved(bank, residual, signals), room(bank, residual, signals)
    # one that takes longer than that is still there then
    first = ticks - 1 if counted == ticks else 0
    window = 1 if counted == ticks else counted
    side, beyond = 0, LEAST_SHARE * float(np.abs(total).max())
    for sign in (1, -1):
        net = sliding_window_view(sign * total - size, window)[first:].min(axis=1).max()
        if net > beyond:
            side, beyond = sign, float(net)
    return side, beyond if side else 0.0


def slalom(vehicle: Vehicle, tick: float) -> dict[str, NDArray[np.float64]]:
    """Return the signals of a body without control in the slalom, on stiff tyres."""
    car, roll = car_of(vehicle), vehicle.design
    acceleration, frequency = SLALOM
    time = np.arange(round(SECONDS / tick)) * tick
    lateral = acceleration * np.sin(2.0 * pi * frequency * time)
    inertia = effective_inertia(car, NOMINAL)
    # J φ'' + C φ' + (K − m g h) φ = m h a
    stiffness = car.stiffness - GRAVITY * roll.roll_arm
    body = [roll.roll_arm], [inertia, roll.roll_damping, stiffness]
    phi = lsim(body, lateral, time)[1]
    rate = np.gradient(phi, tick)
    measured = lateral + GRAVITY * phi
    nothing = np.zeros(len(time))
    return {
        "stroke_front": rate * car.tracks[0],
        "stroke_rear": rate * car.tracks[1],
        **dict.fromkeys(("heave_front", "heave_rear", "moment_front", "moment_rear"), nothing),
        "lateral": measured,
        "turning": lateral,
        "steered": lateral,
        "roll_rate": rate,
        "yaw_rate": lateral / 20.0,
    }
