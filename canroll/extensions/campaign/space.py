"""The space of a campaign's draws: independent or correlated quantities of a unit cube."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from canroll.errors import CanrollError, UnknownNameError
from canroll.extensions.campaign.distributions import EDGE, Continuous, Distribution, Vector

RANDOM, LATIN, SOBOL = "random", "latin_hypercube", "sobol"
SAMPLINGS = (RANDOM, LATIN, SOBOL)

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Correlation:
    """Rank correlation (Spearman) of two continuous quantities."""

    first: str
    second: str
    rank: float


@dataclass(frozen=True, slots=True)
class Space:
    """Quantities with their distributions, in order of their names.

    Correlated ones have a Gaussian copula with the given rank correlations.
    """

    names: tuple[str, ...]
    distributions: tuple[Distribution, ...]
    correlations: tuple[Correlation, ...] = ()

    @property
    def size(self) -> int:
        """Number of dimensions."""
        return len(self.names)

    def values(self, point: Vector) -> dict[str, Any]:
        """Return the value of each quantity at a unit point, one coordinate for each."""
        if self.correlations:
            scores = ndtri(np.clip(point, EDGE, 1.0 - EDGE))
            point = ndtr(self.factor() @ scores)
        cells = {}
        for name, distribution, unit in zip(self.names, self.distributions, point, strict=True):
            value = distribution.quantile(np.array([unit]))[0]
            cells[name] = value.item() if isinstance(value, np.generic) else value
        return cells

    def factor(self) -> Matrix:
        """Return the Cholesky factor of the correlation of the normal scores.

        Raises:
            CanrollError: the correlations contradict each other.
        """
        matrix = np.eye(self.size)
        for pair in self.correlations:
            i, j = self.names.index(pair.first), self.names.index(pair.second)
            # from Spearman's to Pearson's coefficient of two normal variables
            matrix[i, j] = matrix[j, i] = 2.0 * sin(pi * pair.rank / 6.0)
        try:
            return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
        except np.linalg.LinAlgError as error:
            raise CanrollError("the correlations contradict each other: reduce them") from error


def check_correlations(space: Space, where: str) -> None:
    """Reject correlations of quantities that are unknown, discrete, or named twice.

    Raises:
        CanrollError: the message begins with ``where``.
    """
    seen: set[frozenset[str]] = set()
    known = dict(zip(space.names, space.distributions, strict=True))
    for pair in space.correlations:
        for name in (pair.first, pair.second):
            if name not in known:
                raise UnknownNameError(f"quantity of {where}", name, known)
            if not isinstance(known[name], Continuous):
                raise CanrollError(f"{where}: {name} has discrete values, which have no order")
        both = frozenset((pair.first, pair.second))
        if len(both) < 2 or both in seen:
            raise CanrollError(f"{where}: {pair.first} and {pair.second}: each pair once")
        seen.add(both)
    try:
        space.factor()
    except CanrollError as error:
        raise CanrollError(f"{where}: {error}") from error


@dataclass(frozen=True, slots=True)
class Sampling:
    """Unit points of the draws by number; a point depends on the seed and its number alone.

    Attributes:
        method: "random"; "latin_hypercube": each chunk of ``chunk`` draws is one, independent of
            the others (McKay 1979; replicated); "sobol": scrambled (Owen 1998).
        seed: of the campaign.
        chunk: draws of a chunk.
    """

    method: str
    seed: int
    chunk: int

    def points(self, number: int, dimensions: int) -> Matrix:
        """Return the points of a chunk, shape (chunk, dimensions)."""
        if not dimensions:
            return np.zeros((self.chunk, 0))
        if self.method == LATIN:
            random = np.random.default_rng([self.seed, number])
            return qmc.LatinHypercube(dimensions, rng=random).random(self.chunk)
        if self.method == SOBOL:
            sequence = qmc.Sobol(dimensions, rng=np.random.default_rng(self.seed))
            if number:
                sequence.fast_forward(number * self.chunk)
            return sequence.random(self.chunk)
        first = number * self.chunk
        return np.array(
            [self.stream(index).random(dimensions) for index in range(first, first + self.chunk)]
        )

    def stream(self, index: int) -> np.random.Generator:
        """Return the random numbers of one draw."""
        return np.random.default_rng([self.seed, index])

    def again(self, index: int, dimensions: int) -> Iterator[Matrix]:
        """Yield independent points to take instead of a draw's, one after the other."""
        random = self.stream(index)
        random.random(dimensions)
        while True:
            yield random.random(dimensions)
