"""What the designer of the monitors does not know: the box in which car, sensors and road lie."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import inf
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError, UnknownNameError
from canroll.vehicles import Vehicle
from canroll.vehicles.fit_spread import value_of


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Half-widths of what the thresholds must allow for, all of them choices of the user.

    Shares are of the nominal value. The defaults are those of the population in which laws are
    compared (:data:`canroll.studies.variation.DEFAULT_SPREAD`); sensors are as their vehicle file
    says.

    Attributes:
        mass: share of the sprung mass: passengers and luggage.
        height: share of its height above the roll axis: where they are.
        inertia: share of the roll inertia about the CG: of the population's about the roll axis
            twice, as mass times height squared is the rest of it.
        stiffness: share of the suspension's roll stiffness.
        damping: share of the roll damping: temperature and wear.
        tyre: share of the tyres' vertical stiffness: pressure.
        cornering: share of the cornering stiffnesses: load, pressure, tread.
        roll_centre: distance of the axles' roll centres from their stated place: load and
            travel, m.
        moment: share of the delivered moment that is reported wrongly by sound actuators.
        speed: share of the speed: radius of the wheels.
        noise: factor on the sensors' noise densities.
        bias: factor on the sensors' offsets and their drift.
        temperature: largest distance from room temperature, K.
        bank: largest bank of the road, rad.
        bank_rate: largest rate at which it changes under the car, rad/s.
        wind: largest speed of a gust across the road, m/s; 0, as a storm makes as much as moments
            that are lies.
        hill: largest vertical acceleration that crests and dips make for long, m/s².
        sideslip: largest lateral acceleration of the sideslip alone, linear tyres, m/s².
        response: time by which a car follows its steering, s.
        late: share of the stroke rates' samples that come a tick late, twice or not at all.
        bump: time in which a wheel rises on a bump: half a metre at 10 m/s, s.
        alarms_per_hour: wanted rate at which noise and road alone raise a residual.
    """

    mass: float = 0.2
    height: float = 0.2
    inertia: float = 0.4
    stiffness: float = 0.2
    damping: float = 0.2
    tyre: float = 0.1
    cornering: float = 0.1
    roll_centre: float = 0.03
    moment: float = 0.2
    speed: float = 0.02
    noise: float = 1.0
    bias: float = 1.5
    temperature: float = 60.0
    bank: float = 0.175
    bank_rate: float = 0.05
    wind: float = 0.0
    hill: float = 0.9
    sideslip: float = 0.5
    response: float = 0.15
    late: float = 0.1
    bump: float = 0.05
    alarms_per_hour: float = 1e-3


DEFAULT = Uncertainty()
SHARES = (
    "mass",
    "height",
    "inertia",
    "stiffness",
    "damping",
    "tyre",
    "cornering",
    "moment",
    "speed",
)
"""Half-widths that are shares of the nominal value: below 1, so that something is left of it."""


OF_FIT = {
    "plant.roll_stiffness": "stiffness",
    "plant.roll_damping": "damping",
    "plant.roll_inertia": "inertia",
    "plant.cg_height_above_roll_axis": "height",
    "tyre.cornering_stiffness_front": "cornering",
    "tyre.cornering_stiffness_rear": "cornering",
    "geometry.roll_centre_height_front": "roll_centre",
    "geometry.roll_centre_height_rear": "roll_centre",
}
"""Half-widths that a number of a fitted vehicle widens."""
EVERY = frozenset(OF_FIT.values())
BY_STEERING = frozenset({"height", "stiffness", "cornering"})
"""Those that are needed where the body's response is not watched: of the car that is steered."""
SURE = 2.0
"""Standard deviations of a fit that a half-width holds at least: 95 % of the cars it may be."""


def of_vehicle(vehicle: Vehicle, needed: Collection[str] = EVERY) -> Uncertainty:
    """Return the default box, wide enough for what the vehicle was fitted with.

    A fit tells of the car, not of its load, temperature and wear: it narrows nothing. The box holds
    the interval of each number by itself: correlated numbers fill only a part of it.

    Args:
        vehicle: with the spread of its fit, or without.
        needed: half-widths that are made use of; the others stay as they are.

    Raises:
        CanrollError: the fit leaves a share that may be all of the number.
    """
    box = DEFAULT
    if vehicle.fit is None:
        return box
    for key, deviation in zip(vehicle.fit.names, vehicle.fit.deviations, strict=True):
        name = OF_FIT.get(key, "")
        if name not in needed:
            continue
        width = SURE * deviation
        if name in SHARES:
            width /= abs(value_of(vehicle, key))
            if width >= 1.0:
                raise CanrollError(
                    f"{vehicle.name}: the fit knows {key} to ±{100.0 * width:.0f} % only: fit a "
                    "log that tells more, or give the number by --vehicle-set, or what is not "
                    f"known of it by --uncertainty {name}=WIDTH"
                )
        box = replace(box, **{name: max(getattr(box, name), width)})
    return box


def stated(
    choices: Mapping[str, Any], box: Uncertainty = DEFAULT, file: Path | None = None
) -> Uncertainty:
    """Return ``box`` with the half-widths in ``choices``, text or numbers, in their place.

    Args:
        choices: half-widths by their names.
        box: half-widths of all others.
        file: the calibration that they are from; None: the command's options.

    Raises:
        UnknownNameError: there is no such half-width.
        CanrollError: not a number, negative, or a share of 1 and more.
    """
    where, kind = "--uncertainty ", "uncertainty"
    if file is not None:
        where, kind = f"{file}: uncertainty.", f"key of {file}: [uncertainty]"
    for name, text in choices.items():
        if name not in Uncertainty.__dataclass_fields__:
            raise UnknownNameError(kind, name, Uncertainty.__dataclass_fields__)
        try:
            width = float(text)
        except (TypeError, ValueError) as error:
            raise CanrollError(f"{where}{name}={text}: {text!r} is not a number") from error
        if not 0.0 <= width < (1.0 if name in SHARES else inf):
            most = "below 1, a share of the nominal value" if name in SHARES else "0 or more"
            raise CanrollError(f"{where}{name}={text}: must be {most}")
        if name == "alarms_per_hour" and not width:
            raise CanrollError(f"{where}{name}={text}: noise always raises some: above 0")
        box = replace(box, **{name: width})
    return box


@dataclass(frozen=True, slots=True)
class Factors:
    """Factors on the nominal car's numbers: one point of the box."""

    mass: float = 1.0
    height: float = 1.0
    inertia: float = 1.0
    stiffness: float = 1.0
    damping: float = 1.0
    tyre: float = 1.0
    speed: float = 1.0


NOMINAL = Factors()


def vertices(box: Uncertainty, names: Sequence[str]) -> Iterator[Factors]:
    """Yield the corners of the box in the parameters ``names``; the others are nominal."""
    for signs in product((-1.0, 1.0), repeat=len(names)):
        point = {
            name: 1.0 + sign * getattr(box, name) for name, sign in zip(names, signs, strict=True)
        }
        yield replace(NOMINAL, **point)
