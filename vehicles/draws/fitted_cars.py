"""The cars that a fitted vehicle may be: draws from the joint spread of its numbers."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.vehicles import Vehicle
from canroll.vehicles.check import MAY_BE_ZERO, SIGNED, problems
from canroll.vehicles.draws.numbers import applied
from canroll.vehicles.fit_spread import value_of

DRAWS = 20
"""Cars of a family. One more of them is worse than all these with probability 1/21, below 5 %."""
SEED = 1
TRIES = 100
"""Draws instead of one that no car can be, at most."""


def is_positive(key: str) -> bool:
    """Whether the logarithm of a number is what is normal, in priors of fits and in draws of them.

    It is so of what has no bounds but zero, which it never is. A share has 1 as well: it is normal
    itself, and so are numbers of either sign and those that may be zero.
    """
    return not (key.endswith("_share") or any(part in key for part in (*SIGNED, *MAY_BE_ZERO)))


def values_at(vehicle: Vehicle, scores: NDArray[np.float64]) -> dict[str, float]:
    """Return the fitted numbers at correlated standard normal scores (p).

    Numbers that :func:`is_positive` names are log-normal with the fitted one as median, and with a
    standard deviation of the logarithm that is the relative one of the number; all others normal.
    """
    assert vehicle.fit is not None  # its callers ask
    values = {}
    named = zip(vehicle.fit.names, vehicle.fit.deviations, scores.tolist(), strict=True)
    for name, deviation, score in named:
        value = value_of(vehicle, name)
        if is_positive(name):
            values[name] = value * float(np.exp(deviation / value * score))
        else:
            values[name] = value + deviation * score
    return values


def car_with(vehicle: Vehicle, values: Mapping[str, float]) -> Vehicle | None:
    """Return the car with other values of fitted numbers, or None where there can be none.

    Its numbers are known: it has no spread. A body without load has those of the load unchanged.
    """
    try:
        car = applied(replace(vehicle, fit=None), values)
    except CanrollError:
        return None
    return None if any(problems(car)) else car


@lru_cache(maxsize=16)
def draws(vehicle: Vehicle, count: int = DRAWS, seed: int = SEED) -> tuple[Vehicle, ...]:
    """Return cars that a fitted vehicle may be; what no car can be is drawn again.

    Args:
        vehicle: with the spread of its fit; without, there is none.
        count: number of cars.
        seed: of the draws.

    Raises:
        CanrollError: the spread is so wide that hardly any draw is a car.
    """
    if vehicle.fit is None:
        return ()
    random = np.random.default_rng(seed)
    factor = np.asarray(np.linalg.cholesky(vehicle.fit.matrix), dtype=np.float64)
    return tuple(_draw(vehicle, factor, random) for _ in range(count))


def _draw(vehicle: Vehicle, factor: NDArray[np.float64], random: np.random.Generator) -> Vehicle:
    for _ in range(TRIES):
        values = values_at(vehicle, factor @ random.standard_normal(len(factor)))
        car = car_with(vehicle, values)
        if car is not None:
            return car
    raise CanrollError(
        f"{vehicle.name}: no car in {TRIES} draws of [fit]: its deviations are too wide; fit again "
        "with more numbers held"
    )
