"""What the residuals of a car can find: the least size of each fault, and what tells them apart."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, pi

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lsim

from gain_gen.monitors.bank import STEP, Bank, Residual
from gain_gen.monitors.noise import response
from gain_gen.monitors.residuals import car_of, effective_inertia
from gain_gen.monitors.uncertainty import NOMINAL
from vehicles import GRAVITY, Vehicle

TOLERATED = 0.3
"""Time after its beginning in which a fault is to be found, s."""
SLALOM = 4.0, 0.4
"""Lateral acceleration, m/s², and frequency, Hz, of the slalom that bounds are evaluated in."""
SECONDS = 8.0


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault: what a unit of it adds to signals; a false moment is what is reported too much."""

    name: str
    unit: str
    signals: Mapping[str, float]


FAULTS = (
    Fault("front moment", "N·m", {"moment_front": 1.0}),
    Fault("rear moment", "N·m", {"moment_rear": 1.0}),
    Fault("lateral acceleration", "m/s²", {"lateral": 1.0}),
    Fault("roll rate", "rad/s", {"roll_rate": 1.0}),
    Fault("front stroke rate", "m/s", {"stroke_front": 1.0}),
    Fault("rear stroke rate", "m/s", {"stroke_rear": 1.0}),
    Fault("both sides of an axle", "m/s", {"heave_rear": 1.0}),
)


@dataclass(frozen=True, slots=True)
class Limit:
    """Least size of a fault that a residual finds within :data:`TOLERATED`.

    Attributes:
        fault: which.
        residual: name of the residual.
        side: of the residual, for a positive fault.
        straight: least size on a straight, even road; infinite: it does not see it.
        slalom: least size at the worst moment of :data:`SLALOM`.
    """

    fault: Fault
    residual: str
    side: int
    straight: float
    slalom: float


def limits(bank: Bank, vehicle: Vehicle) -> tuple[Limit, ...]:
    """Return the limits of every fault and residual that sees it."""
    driven = slalom(vehicle, bank.tick)
    found = []
    for residual in bank.residuals:
        threshold = largest_threshold(bank, residual, driven)
        for fault in FAULTS:
            effect, widened = effects(bank, residual, fault)
            # what the threshold itself grows by for the fault cannot be found
            net = abs(effect) - widened
            if net > 0.01 * abs(effect):
                side = 1 if effect > 0.0 else -1
                sizes = residual.floor / net, (residual.floor + threshold) / net
                found.append(Limit(fault, residual.name, side, *sizes))
    return tuple(found)


def least(table: tuple[Limit, ...], fault: str) -> tuple[float, float]:
    """Return the least sizes of a fault that any residual finds: on a straight, in the slalom."""
    of_fault = [limit for limit in table if limit.fault.name == fault]
    return (
        min((limit.straight for limit in of_fault), default=inf),
        min((limit.slalom for limit in of_fault), default=inf),
    )


def effects(bank: Bank, residual: Residual, fault: Fault) -> tuple[float, float]:
    """Return what a unit of a fault makes of a residual, and of its threshold, N·m per unit.

    The least after :data:`TOLERATED` while it counts: what is washed out has been seen by then.
    """
    ticks = max(2, round(TOLERATED / bank.tick))
    counted = bank.rounds(residual.time)
    total, size = np.zeros(ticks), np.zeros(ticks)
    for term in residual.terms:
        part = bank.parts[term.part]
        gain = sum(part.gains.get(name, 0.0) * value for name, value in fault.signals.items())
        if gain and part.kind != STEP:
            of_part = response(part, np.full(ticks, gain), bank.tick)
            total += term.sign * of_part
            size += term.weight * np.abs(of_part)
    if counted >= ticks:
        return float(total[-1]), float(size[-1])
    best = max(range(counted, ticks + 1), key=lambda k: np.abs(total[k - counted : k]).min())
    window = slice(best - counted, best)
    worst = int(np.abs(total[window]).argmin())
    return float(total[window][worst]), float(size[window].max())


def largest_threshold(
    bank: Bank, residual: Residual, driven: Mapping[str, NDArray[np.float64]]
) -> float:
    """Return the largest threshold above the floor in a run with these signals, N·m."""
    size = np.zeros(len(driven["lateral"]))
    for term in residual.terms:
        part = bank.parts[term.part]
        signal = sum((gain * driven[name] for name, gain in part.gains.items()), 0.0 * size)
        of_part = np.abs(np.diff(signal, prepend=0.0)).mean() + 0.0 * size
        if part.kind != STEP:
            of_part = np.abs(response(part, signal, bank.tick))
        size += term.weight * of_part
    return float(size[len(size) // 2 :].max())


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
        **dict.fromkeys(
            ("heave_front", "heave_rear", "moment_front", "moment_rear", "gyro_bias"), nothing
        ),
        "lateral": measured,
        "turning": lateral,
        "steered": lateral,
        "roll_rate": rate,
        "yaw_rate": lateral / 20.0,
    }
