"""The numbers that a log may tell: of the vehicle and of the measurement, with their priors."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import exp
from math import log as natural

from canroll.errors import CanrollError, UnknownNameError
from canroll.extensions.car.identification.drive_log import QUANTITIES
from canroll.vehicles import Vehicle
from canroll.vehicles.axle_files import following
from canroll.vehicles.draws import numbers as vehicle_numbers
from canroll.vehicles.draws.fitted_cars import is_positive
from canroll.vehicles.fit_spread import value_of

LOG = "log"
"""Section of the unknowns of the measurement, which no vehicle file has."""
STEERING_OFFSET = f"{LOG}.steering_offset"


@dataclass(frozen=True, slots=True)
class Unknown:
    """A number to fit: key of the vehicle file or of the log, label, unit, prior and bounds.

    ``mean`` and ``deviation`` are those of the prior, in ``unit``; ``prior`` says where its spread
    is from. The key of one number of a list ends in its place. The prior of a ``positive`` number
    is normal in its logarithm, that of another in itself; its coordinate is the distance from the
    mean in deviations of that prior.
    """

    key: str
    label: str
    unit: str
    mean: float
    deviation: float
    least: float
    most: float
    prior: str
    positive: bool = False

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value in ``unit``."""
        if self.positive:
            return natural(value / self.mean) * self.mean / self.deviation
        return (value - self.mean) / self.deviation

    def value(self, coordinate: float) -> float:
        """Return the value in ``unit`` at a coordinate."""
        if self.positive:
            return self.mean * exp(coordinate * self.deviation / self.mean)
        return self.mean + coordinate * self.deviation

    def slope(self, value: float) -> float:
        """Return the change of the value by that of the coordinate, at ``value``."""
        return self.deviation * (value / self.mean if self.positive else 1.0)

    @property
    def of_log(self) -> bool:
        """Whether it is a number of the measurement."""
        return self.key.startswith(f"{LOG}.")


STATES = {
    "identified": "",
    "together": "only in combination",
    "bound": "at its bound",
    "kept": "not from the log",
}
"""States of fitted numbers, and what people call them."""


@dataclass(frozen=True, slots=True)
class FittedNumber:
    """A fitted number and its standard deviation, in the unit of its unknown.

    ``state``: "identified"; identified only "together" with others, where the log says less of the
    number than was known before; at its "bound", which is no fit; or "kept" at its prior, of which
    the log says nothing.
    """

    unknown: Unknown
    value: float
    deviation: float
    state: str

    @property
    def learnt(self) -> float:
        """How much smaller the deviation is than the prior's, 0 to 1."""
        return max(1.0 - self.deviation / self.unknown.slope(self.value), 0.0)

    def to_json(self) -> dict[str, float | str]:
        """Return the number as plain data."""
        return {
            "key": self.unknown.key,
            "unit": self.unknown.unit,
            "value": self.value,
            "deviation": self.deviation,
            "state": self.state,
            "learnt": self.learnt,
            "prior": self.unknown.mean,
            "prior_deviation": self.unknown.deviation,
        }


@dataclass(frozen=True, slots=True)
class Number:
    """Label and unit of a vehicle's number; the usual spread of a guess, relative or absolute."""

    label: str
    unit: str
    relative: float = 0.0
    absolute: float = 0.0
    least: float = -1.0
    most: float = 1.0


NUMBERS = {
    "tyre.cornering_stiffness_front": Number("cornering stiffness, front", "N/rad", 0.25),
    "tyre.cornering_stiffness_rear": Number("cornering stiffness, rear", "N/rad", 0.25),
    "tyre.cornering_load_slope": Number(
        "fall of cornering stiffness over load", "", 0.0, 0.1, 0.0, 0.49
    ),
    "tyre.friction": Number("friction", "", 0.1),
    "tyre.relaxation_length": Number("relaxation length", "m", 0.3),
    "mass.yaw_inertia": Number("yaw inertia", "kg·m²", 0.15),
    "plant.roll_inertia": Number("roll inertia", "kg·m²", 0.2),
    "plant.roll_damping": Number("roll damping", "N·m·s/rad", 0.5),
    "plant.roll_stiffness": Number("roll stiffness", "N·m/rad", 0.25),
    "plant.cg_height_above_roll_axis": Number("CG above roll axis", "m", 0.15),
    "geometry.roll_centre_height_front": Number("roll centre, front", "m", 0.0, 0.04, -0.2, 0.5),
    "geometry.roll_centre_height_rear": Number("roll centre, rear", "m", 0.0, 0.04, -0.2, 0.8),
    "suspension.roll_stiffness_front_share": Number(
        "front share of roll stiffness", "", 0.0, 0.07, 0.1, 0.9
    ),
    "suspension.roll_damping_front_share": Number(
        "front share of roll damping", "", 0.0, 0.1, 0.1, 0.9
    ),
    "steering.ratio": Number("steering ratio", "", 0.03),
    "sensors.imu_position.0": Number("inertial unit ahead of CG", "m", 0.0, 0.4, -3.0, 3.0),
    "sensors.imu_position.2": Number("inertial unit above CG", "m", 0.0, 0.25, -1.0, 2.0),
}
"""What of a vehicle file can be fitted."""
WIDEST = 4.0
"""A positive number may become so many times smaller or larger than its prior mean."""
DELAY = 0.02
"""Usual difference (s) between the stamps of two sensors."""
OFFSETS = {"angle": 0.02, "rate": 0.02, "acceleration": 0.5, "length": 0.01}
"""Usual offset of a sensor by kind of quantity, SI units."""
STEERING_SPREAD = 0.06
"""Usual angle (rad) of a steering wheel in straight driving."""

KNOWN = ("measured", "given")
"""First words of the source of a number that is not guessed: it is held."""
_SPREAD = r"±\s*([\d.]+(?:e[+-]?\d+)?)\s*(%?)"


def unknowns(
    vehicle: Vehicle,
    signals: Sequence[str],
    *,
    free: Collection[str] = (),
    held: Collection[str] = (),
) -> tuple[Unknown, ...]:
    """Return the unknowns of a vehicle and of the log of its ``signals``.

    What follows from tables of the axles is held: those are measured.
    The spread of a number is that of its source, "±17 %", else the usual one of a guess. Numbers
    whose source begins with a word of :data:`KNOWN` are held.

    Args:
        vehicle: where the fit starts: its numbers are the means of the priors.
        signals: measured outputs, names of :data:`QUANTITIES`.
        free: keys to fit though they are known.
        held: keys to hold.

    Raises:
        UnknownNameError: a key that cannot be fitted.
        CanrollError: a key to fit follows from tables, a key is free and held, or nothing is left.
    """
    by_tables = {} if vehicle.axles is None else following(vehicle.axles)
    of_vehicle = tuple(u for u in _of_vehicle(vehicle) if u.key not in by_tables)
    result = (*of_vehicle, *_of_log(signals))
    keys = [unknown.key for unknown in result]
    for key in (*free, *held):
        if key in free and key in by_tables:
            raise CanrollError(
                f"{key} follows from {by_tables[key]}, which is measured: it is not fitted"
            )
        if key not in keys:
            raise UnknownNameError("number that a log may tell", key, keys)
        if key in free and key in held:
            raise CanrollError(f"{key}: it is to be fitted and to be held: choose one")
    known = {u.key for u in of_vehicle if is_known(vehicle, u.key)} - {*free}
    result = tuple(u for u in result if u.key not in known and u.key not in held)
    if not result:
        raise CanrollError("no number is left to fit: every one is held")
    return result


def _of_vehicle(vehicle: Vehicle) -> Iterator[Unknown]:
    for key, number in NUMBERS.items():
        if key.startswith("tyre.") and vehicle.magic_formula is not None:
            continue
        yield of_key(vehicle, key, number)


def of_key(vehicle: Vehicle, key: str, number: Number) -> Unknown:
    """Return the unknown of a vehicle's number, its prior from the source or the usual one."""
    mean, source = value_of(vehicle, key), _origin(vehicle, key)
    usual = number.absolute or number.relative * abs(mean)
    place = key.rpartition(".")[2]
    # of a list the spread of each number is followed by its place
    match = re.search(_SPREAD + (rf"[^;]*\[{place}\]" if place.isdecimal() else ""), source)
    deviation, prior = usual, "usual spread of an estimate"
    if match and float(match[1]) > 0.0:
        deviation = float(match[1]) * (abs(mean) / 100 if match[2] else 1.0)
        prior = source.partition(":")[0]
    positive = is_positive(key)
    if positive:
        least, most = mean / WIDEST, mean * WIDEST
    else:
        least, most = min(number.least, mean), max(number.most, mean)
    return Unknown(key, number.label, number.unit, mean, deviation, least, most, prior, positive)


def is_known(vehicle: Vehicle, key: str) -> bool:
    """Whether the source of a number says that it is no guess."""
    return _origin(vehicle, key).startswith(KNOWN)


def _origin(vehicle: Vehicle, key: str) -> str:
    """Return the source of a number, without the vehicles that it was taken over from."""
    return re.sub(r"^(?:of (?:base )?[^:]+: )+", "", vehicle.source(key))


def _of_log(signals: Sequence[str]) -> Iterator[Unknown]:
    spread = STEERING_SPREAD
    yield Unknown(STEERING_OFFSET, "steering offset", "rad", 0.0, spread, -0.5, 0.5, "usual")
    for name in signals:
        quantity = QUANTITIES[name]
        deviation = OFFSETS[quantity.kind]
        unit, most = quantity.unit, 10 * deviation
        label = f"{quantity.label} offset"
        yield Unknown(offset_key(name), label, unit, 0.0, deviation, -most, most, "usual")
    for name in signals:
        label = f"{QUANTITIES[name].label} delay"
        yield Unknown(delay_key(name), label, "s", 0.0, DELAY, -0.15, 0.15, "usual")


def offset_key(signal: str) -> str:
    """Key of the offset of a signal, added to what the car does."""
    return f"{LOG}.{signal}_offset"


def delay_key(signal: str) -> str:
    """Key of how much later a signal is stamped than the steering."""
    return f"{LOG}.{signal}_delay"


def applied(vehicle: Vehicle, values: Mapping[str, float]) -> Vehicle:
    """Return :func:`canroll.vehicles.draws.numbers.applied` without the values of the log."""
    of_car = {key: value for key, value in values.items() if not key.startswith(f"{LOG}.")}
    return vehicle_numbers.applied(vehicle, of_car)
