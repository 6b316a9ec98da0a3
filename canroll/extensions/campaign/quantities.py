"""What a campaign can draw, and the settings of a run with the drawn values."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from math import asin, pi
from typing import Any

from canroll.errors import CanrollError, UnknownNameError
from canroll.extensions.campaign.distributions import Continuous, Distribution, is_number
from canroll.extensions.campaign.space import Correlation
from canroll.plant_sim.can_bus import load_profile
from canroll.plant_sim.driving import MANEUVERS, maneuvers
from canroll.plant_sim.faults import parse_all
from canroll.runs import conditions
from canroll.runs.experiment import maneuver_of
from canroll.runs.result import Run
from canroll.studies.variation import ROLL_MODEL, TYRES
from canroll.vehicles import Vehicle, axle_files, tyre_files
from canroll.vehicles.check import problems
from canroll.vehicles.draws.fitted_cars import is_positive
from canroll.vehicles.draws.numbers import with_numbers
from canroll.vehicles.fit_spread import value_of
from canroll.vehicles.roll_stiffness import springs_within

WORDS = ("bus", "scenario")
NUMBERS = ("speed_kmh", "speed", "phase_ms")
FAULTS = "faults"
GROUPS = ("vehicle", "option", "condition")
OF_FIT = "fit."
"""Start of the names of fitted numbers, which are drawn from the vehicle's [fit] together."""
GIVEN = (
    *NUMBERS,
    *WORDS,
    *(f"vehicle.{name}" for name in (*ROLL_MODEL, *TYRES)),
    "vehicle.PART.KEY",
    "option.NAME",
    "condition.NAME",
)
"""Names of quantities: factors on ``speed`` and on the ``vehicle``; all others are the values."""


def check(nominal: Run, name: str, distribution: Distribution, where: str) -> None:
    """Reject a quantity that cannot be drawn from a distribution.

    Args:
        nominal: settings of the run that the draws vary.
        name: of the quantity.
        distribution: its distribution.
        where: file and key, or option, for messages.

    Raises:
        CanrollError: no such quantity, or values that it cannot take.
    """
    group, _, member = name.partition(".")
    if name not in (*WORDS, *NUMBERS, FAULTS) and not (group in GROUPS and member):
        raise UnknownNameError(f"quantity of {where}", name, GIVEN)
    for value in distribution.extremes():
        try:
            _check_value(nominal, name, value)
        except CanrollError as error:
            number = not isinstance(value, str | tuple)
            hint = _hint(distribution) if number and group != "vehicle" else ""
            raise CanrollError(f"{where}: {error}{hint}") from error


def _hint(distribution: Distribution) -> str:
    unbounded = getattr(distribution, "kind", "") in ("normal", "lognormal")
    return ": restrict the distribution with within = [LEAST, MOST]" if unbounded else ""


def _check_value(nominal: Run, name: str, value: Any) -> None:  # noqa: ANN401
    if name == FAULTS:
        parse_all(value)
    elif isinstance(value, str) != _is_text(nominal, name):
        raise CanrollError(f"{value!r} must be {'a number' if isinstance(value, str) else 'text'}")
    elif not isinstance(value, str | bool) and not is_number(value):
        raise CanrollError(f"{value!r} must be a finite number")
    if name == "scenario" and value not in MANEUVERS:
        raise UnknownNameError("scenario", value, MANEUVERS)
    if name == "bus":
        load_profile(value, nominal.dbc, nominal.map)
    factor = name == "speed" or name.startswith("vehicle.")
    if (factor or name == "speed_kmh") and not value > 0:
        raise CanrollError(f"{value:g} must be positive")
    if name == "phase_ms" and not 0 <= value <= 1e3 * nominal.tick:
        raise CanrollError(f"{value:g} must be 0 to {1e3 * nominal.tick:g} ms")
    settings = drawn(nominal, {name: value}, seed=nominal.seed)
    conditions.options(dict(settings.conditions))
    maneuver_of(replace(settings, vehicle=nominal.vehicle))


def _is_text(nominal: Run, name: str) -> bool:
    group, _, member = name.partition(".")
    return name in WORDS or (group == "option" and isinstance(_option(nominal, member), str))


def _option(nominal: Run, name: str) -> Any:  # noqa: ANN401
    known = maneuvers.options(nominal.scenario)
    if name not in known:
        raise UnknownNameError(f"option of {nominal.scenario}", name, known)
    return known[name]


def drawn(nominal: Run, values: Mapping[str, Any], *, seed: int) -> Run:
    """Return the settings with the drawn ``values`` and the ``seed`` of noise and background."""
    changes: dict[str, Any] = {"seed": seed}
    options, actual = dict(nominal.options), dict(nominal.conditions)
    vehicle = nominal.vehicle
    fitted = {n.removeprefix(OF_FIT): values[n] for n in values if n.startswith(OF_FIT)}
    if fitted:
        # the controller stays that of the fitted vehicle
        known = replace(vehicle, fit=None)
        vehicle = replace(with_numbers(known, fitted), design=vehicle.design)
    for name, value in values.items():
        group, _, member = name.partition(".")
        if name in (*WORDS, FAULTS):
            changes[name] = value
        elif name == "speed":
            changes["speed"] = changes.get("speed", nominal.speed) * float(value)
        elif name == "speed_kmh":
            changes["speed"] = float(value) / 3.6
        elif name == "phase_ms":
            changes["phase"] = 1e-3 * float(value)
        elif group == "option":
            options[member] = value
        elif group == "condition":
            actual[member] = value
        elif group == "vehicle":
            vehicle = _scaled(vehicle, member, float(value))
    if vehicle is not nominal.vehicle and is_vehicle(vehicle):
        vehicle = springs_within(vehicle)
    return replace(
        nominal,
        vehicle=vehicle,
        options=tuple(sorted(options.items())),
        conditions=tuple(sorted(actual.items())),
        **changes,
    )


def is_vehicle(vehicle: Vehicle) -> bool:
    """Whether a vehicle with these numbers can exist."""
    if any(problems(vehicle)):
        return False
    try:
        springs_within(vehicle)
    except CanrollError:
        return False
    return True


def of_fit(vehicle: Vehicle) -> tuple[dict[str, Distribution], tuple[Correlation, ...]]:
    """Return the fitted numbers of a vehicle with their distributions, and the correlations.

    They are those of :func:`canroll.vehicles.draws.fitted_cars.values_at`; empty without a fit.
    """
    if vehicle.fit is None:
        return {}, ()
    drawn: dict[str, Distribution] = {}
    for name, deviation in zip(vehicle.fit.names, vehicle.fit.deviations, strict=True):
        value = value_of(vehicle, name)
        if is_positive(name):
            drawn[OF_FIT + name] = Continuous("lognormal", value, deviation / value)
        else:
            drawn[OF_FIT + name] = Continuous("normal", value, deviation)
    names = tuple(drawn)
    pairs = tuple(
        # from Pearson's coefficient of two normal variables to Spearman's
        Correlation(names[i], names[j], 6.0 * asin(row[j] / 2.0) / pi)
        for i, row in enumerate(vehicle.fit.correlation)
        for j in range(i)
    )
    return drawn, pairs


def is_of_fit(vehicle: Vehicle, name: str) -> bool:
    """Whether a quantity is a factor on a number that is drawn from the vehicle's fit."""
    group, _, member = name.partition(".")
    if vehicle.fit is None or group != "vehicle":
        return False
    twice = _scaled(vehicle, member, 2.0)
    return any(value_of(twice, key) != value_of(vehicle, key) for key in vehicle.fit.names)


def _scaled(vehicle: Vehicle, name: str, factor: float) -> Vehicle:
    if name in TYRES:
        return tyre_files.scaled(vehicle, *(factor if name == each else 1.0 for each in TYRES))
    axle_files.check_change(vehicle, name)
    path = ("plant", name) if name in ROLL_MODEL else tuple(name.split("."))
    changed: Vehicle = _scaled_at(vehicle, path, factor, name)
    return tyre_files.followed(changed)


def _scaled_at(part: Any, path: tuple[str, ...], factor: float, name: str) -> Any:  # noqa: ANN401
    """Return a part of a vehicle with the number at ``path`` multiplied."""
    known = [field.name for field in fields(part)] if is_dataclass(part) else []
    if path[0] not in known or path[0] == "design":
        names = [*known, *ROLL_MODEL, *TYRES] if len(path) == len(name.split(".")) else known
        raise UnknownNameError(f"part of vehicle.{name}:", path[0], names)
    value = getattr(part, path[0])
    if len(path) > 1:
        changed = _scaled_at(value, path[1:], factor, name)
    elif is_number(value):
        changed = value * factor
    else:
        raise CanrollError(f"vehicle.{name} is not a number of the vehicle's file")
    return replace(part, **{path[0]: changed})
