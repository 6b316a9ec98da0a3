"""Random variation of the vehicle: populations in which laws are compared."""

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np

from canroll.errors import CanrollError, UnknownNameError
from canroll.runs.result import Run
from canroll.vehicles import Vehicle
from canroll.vehicles.check import problems
from canroll.vehicles.model import RollModel
from canroll.vehicles.roll_stiffness import springs_within
from canroll.vehicles.tyre_files import scaled

ROLL_MODEL = tuple(field.name for field in fields(RollModel))
TYRES = ("cornering_stiffness", "friction")
CONDITIONS = ("estimate_error",)
"""Conditions of the actuators that are drawn about zero: the delivered moment's reported error."""
DEFAULT_SPREAD: Mapping[str, float] = {
    **dict.fromkeys(ROLL_MODEL, 0.2),
    **dict.fromkeys(TYRES, 0.1),
    **dict.fromkeys(CONDITIONS, 0.2),
    "speed": 0.0,
}
"""Half-widths, as share of the nominal value, that each quantity is drawn from, evenly."""
NONE: Mapping[str, float] = dict.fromkeys(DEFAULT_SPREAD, 0.0)
"""Of draws that differ in their noise, phases and background traffic alone."""
SHARE_MAX: Mapping[str, float] = {"estimate_error": 0.2}
"""Largest half-width, below 1, of quantities bounded by the actuators."""
TRIES = 100


def spread_from(given: Mapping[str, str | float]) -> dict[str, float]:
    """Return the default spread with the fractions in ``given``, numbers or text, replaced.

    Raises:
        UnknownNameError: no such quantity.
        CanrollError: a fraction that is not a number or outside 0 to 0.99 (estimate_error: 0.2).
    """
    spread = dict(DEFAULT_SPREAD)
    for name, text in given.items():
        if name not in spread:
            raise UnknownNameError("quantity", name, spread)
        try:
            share = float(text)
        except (TypeError, ValueError) as error:
            raise CanrollError(f"spread {name}={text}: {text!r} is not a number") from error
        most = SHARE_MAX.get(name, 0.99)
        if not 0.0 <= share <= most:
            raise CanrollError(f"spread {name}={text}: must be a fraction from 0 to {most:g}")
        spread[name] = share
    return spread


def draw(
    nominal: Run,
    index: int,
    *,
    spread: Mapping[str, float],
    seed: int,
) -> Run:
    """Return draw ``index`` of a population; it depends only on ``seed`` and ``index``.

    The driven vehicle varies, the one the controller was designed for does not. Noise, phases and
    background traffic have the seed ``index``.

    Args:
        nominal: nominal settings.
        index: number of the draw.
        spread: half-width of each quantity, as a fraction of its nominal value.
        seed: of the population.

    Raises:
        CanrollError: no valid vehicle can be drawn from this spread.
    """
    random = np.random.default_rng([seed, index])
    names = sorted(spread)
    for _ in range(TRIES):
        shares = random.uniform(-1.0, 1.0, len(names))
        factors = {
            name: 1.0 + spread[name] * float(share)
            for name, share in zip(names, shares, strict=True)
        }
        vehicle = varied(nominal.vehicle, factors)
        if not any(problems(vehicle)):
            break
    else:
        raise CanrollError("spread: no valid vehicle in 100 draws: reduce the spread")
    errors = {name: f"{factors[name] - 1.0:.6g}" for name in CONDITIONS if spread[name]}
    return replace(
        nominal,
        vehicle=springs_within(vehicle),
        seed=index,
        speed=nominal.speed * factors["speed"],
        conditions=tuple(sorted({**errors, **dict(nominal.conditions)}.items())),
    )


def population(nominal: Run, count: int, spread: Mapping[str, float]) -> list[Run]:
    """Return draws 0 to ``count`` − 1 of seed 0: the same worlds for every law.

    Raises:
        CanrollError: no valid vehicle can be drawn from this spread.
    """
    return [draw(nominal, index, spread=spread, seed=0) for index in range(count)]


def varied(vehicle: Vehicle, factors: Mapping[str, float]) -> Vehicle:
    """Return the vehicle with the plant's roll model and the tyres multiplied by ``factors``."""
    plant = {name: getattr(vehicle.plant, name) * factors[name] for name in ROLL_MODEL}
    driven = replace(vehicle, plant=replace(vehicle.plant, **plant))
    return scaled(driven, *(factors[name] for name in TYRES))
