"""Distributions of a campaign's quantities, and how a campaign file writes them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from math import inf, isfinite
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from canroll.documents import refuse_unknown
from canroll.errors import CanrollError

Vector = NDArray[np.float64]

KINDS = ("uniform", "normal", "lognormal", "values")
EDGE = 2.0**-53
"""Distance of a unit coordinate from 0 and 1: the resolution of a random number."""
FAR = 1e-12
"""Probability beyond which the tail of an unbounded distribution is not checked."""


class Distribution(Protocol):
    """A distribution by its quantiles."""

    def quantile(self, unit: Vector) -> NDArray[Any]:
        """Return the values below which a draw falls with probability ``unit``."""

    def extremes(self) -> Sequence[Any]:
        """Return the values that must be valid for every draw to be."""

    def to_json(self) -> object:
        """Return it as plain data."""


@dataclass(frozen=True, slots=True)
class Continuous:
    """A uniform, normal or lognormal distribution, restricted to ``within``.

    Attributes:
        kind: "uniform" (least, most), "normal" (mean, standard deviation) or "lognormal" (median,
            standard deviation of the logarithm).
        first: first parameter.
        second: second parameter.
        within: least and largest value; the distribution is conditional on them.
    """

    kind: str
    first: float
    second: float
    within: tuple[float, float] = (-inf, inf)

    def quantile(self, unit: Vector) -> Vector:
        """Return the values below which a draw falls with probability ``unit``."""
        unit = np.clip(unit, EDGE, 1.0 - EDGE)
        if self.kind == "uniform":
            return self.first + unit * (self.second - self.first)
        low, high = (ndtr(self._score(edge)) for edge in self.within)
        scores = self.second * ndtri(np.clip(low + unit * (high - low), EDGE, 1.0 - EDGE))
        free = self.first + scores if self.kind == "normal" else self.first * np.exp(scores)
        return np.asarray(np.clip(free, *self.within), dtype=np.float64)

    def _score(self, value: float) -> float:
        """Return the standard normal score of a value."""
        if self.kind == "normal":
            return (value - self.first) / self.second
        return float(np.log(value / self.first)) / self.second if value > 0.0 else -inf

    def extremes(self) -> tuple[float, float]:
        """Return the ends, of an unbounded distribution the values of probability 1e-12."""
        low, high = self.quantile(np.array([FAR, 1.0 - FAR]))
        return float(low), float(high)

    def to_json(self) -> object:
        """Return it as the campaign file writes it."""
        written: dict[str, object] = {self.kind: [self.first, self.second]}
        if self.kind != "uniform" and self.within != (-inf, inf):
            written["within"] = list(self.within)
        return written


@dataclass(frozen=True, slots=True)
class Discrete:
    """One of ``values``, the first with probability ``shares[0]``, and so on."""

    values: tuple[Any, ...]
    shares: tuple[float, ...]

    def quantile(self, unit: Vector) -> NDArray[Any]:
        """Return the values at the unit coordinates."""
        edges = np.array(list(accumulate(self.shares))[:-1])
        known = np.empty(len(self.values), dtype=object)
        known[:] = self.values
        return known[np.searchsorted(edges, unit, side="right")]

    def extremes(self) -> tuple[Any, ...]:
        """Return all values."""
        return self.values

    def to_json(self) -> object:
        """Return it as the campaign file writes it."""
        values = [list(value) if isinstance(value, tuple) else value for value in self.values]
        return {"values": values, "weights": list(self.shares)}


def evenly(values: Sequence[Any]) -> Discrete:
    """Return the distribution in which each of ``values`` is as probable."""
    return Discrete(tuple(values), (1.0 / len(values),) * len(values))


def read(written: object, where: str) -> Distribution:
    """Return the distribution that a campaign file writes.

    Args:
        written: {uniform = [least, most]}, {normal = [mean, sd], within = [least, most]},
            {lognormal = [median, sd of the logarithm], within = …} or {values = […], weights = […]}
        where: file and key, for messages.

    Raises:
        CanrollError: it is invalid; the message names file and key.
    """
    if not isinstance(written, Mapping) or not written:
        example = "{uniform = [0.9, 1.1]}"
        raise CanrollError(f"{where}: {written!r} is not a distribution, write e.g. {example}")
    kinds = [name for name in written if name in KINDS]
    refuse_unknown(written, (*KINDS, "within", "weights"), f"key of {where}")
    if len(kinds) != 1:
        raise CanrollError(f"{where}: needs exactly one of {', '.join(KINDS)}")
    kind = kinds[0]
    if kind == "values":
        return _discrete(written, where)
    if "weights" in written:
        raise CanrollError(f"{where}: weights belong to values, not to {kind}")
    return _continuous(kind, written, where)


def _continuous(kind: str, written: Mapping[str, Any], where: str) -> Continuous:
    first, second = _pair(written[kind], f"{where}.{kind}")
    if kind == "uniform":
        if "within" in written:
            raise CanrollError(f"{where}: within is for normal and lognormal, uniform has ends")
        if not first < second:
            raise CanrollError(f"{where}.uniform: {first:g} must be below {second:g}")
        return Continuous(kind, first, second, (first, second))
    if second <= 0.0:
        raise CanrollError(f"{where}.{kind}: the standard deviation {second:g} must be positive")
    if kind == "lognormal" and first <= 0.0:
        raise CanrollError(f"{where}.lognormal: the median {first:g} must be positive")
    if "within" not in written:
        return Continuous(kind, first, second)
    low, high = _pair(written["within"], f"{where}.within")
    distribution = Continuous(kind, first, second, (low, high))
    if not low < high or ndtr(distribution._score(high)) - ndtr(distribution._score(low)) < FAR:
        raise CanrollError(f"{where}.within: [{low:g}, {high:g}] holds none of the distribution")
    return distribution


def _pair(written: object, where: str) -> tuple[float, float]:
    if not isinstance(written, list) or len(written) != 2 or not all(map(is_number, written)):
        raise CanrollError(f"{where}: {written!r} must be two finite numbers")
    return float(written[0]), float(written[1])


def _discrete(written: Mapping[str, Any], where: str) -> Discrete:
    if "within" in written:
        raise CanrollError(f"{where}: within is for normal and lognormal")
    values = written["values"]
    if not isinstance(values, list) or not values:
        raise CanrollError(f"{where}.values: {values!r} must be a list of at least one value")
    weights = written.get("weights", [1.0] * len(values))
    if not isinstance(weights, list) or len(weights) != len(values):
        raise CanrollError(f"{where}.weights: needs {len(values)} numbers, one for each value")
    if not all(map(is_number, weights)) or min(weights) < 0 or sum(weights) <= 0:
        raise CanrollError(f"{where}.weights: must not be negative, nor all zero")
    total = float(sum(weights))
    return Discrete(tuple(values), tuple(float(weight) / total for weight in weights))


def is_number(value: object) -> bool:
    """Whether it is a finite number, and not a switch."""
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
