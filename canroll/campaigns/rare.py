"""Probability of a rare event by subset simulation over the draws.

The event is approached by levels, each reached by about a tenth of the samples on the level before
(Au and Beck 2001). On a level Markov chains start from the samples that reached it; a step moves
the normal scores of the quantities by a correlated Gaussian proposal (Papaioannou et al. 2015) and
redraws the seed of noise and background traffic half of the time; it is accepted if it stays on
the level. The probability is the product of the shares of the levels. Its coefficient of variation
is the sum of those of the levels: the bound for levels that depend on each other as much as
possible (Au and Beck 2001, section 5.2), so that the interval is rather wide.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from math import exp, log, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

SHARE = 0.1
"""Share of the samples that reach the next level."""
STAY = 0.8
"""Correlation of a proposal with the state it starts from."""
RESEED = 0.5
"""Probability with which a proposal has a new seed."""
LEVELS = 12
"""Levels after which a probability is below what can be estimated: 1e-12."""
SEEDS = 2**31 - 1
NORMAL_95 = 1.959964
EVENT = 1.0

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples: normal scores (samples, dimensions), seed and level of each."""

    scores: Matrix
    seeds: NDArray[np.int64]
    level: Vector

    def __len__(self) -> int:
        return len(self.level)

    def taken(self, which: NDArray[np.int64]) -> "Samples":
        """Return the samples ``which``."""
        return Samples(self.scores[which], self.seeds[which], self.level[which])


def joined(parts: list[Samples]) -> Samples:
    """Return samples one after the other."""
    return Samples(
        np.concatenate([part.scores for part in parts]),
        np.concatenate([part.seeds for part in parts]),
        np.concatenate([part.level for part in parts]),
    )


Evaluate = Callable[[str, Matrix, NDArray[np.int64]], Vector]
"""Returns the level of each sample from the name of the batch, unit points and seeds; at least 1:
the event; −inf: an invalid draw."""


@dataclass
class Estimate:
    """An estimated probability.

    Attributes:
        probability: of the event.
        variation: its coefficient of variation.
        levels: level and share of the samples that reached it, from the first to the event.
        runs: samples evaluated.
        event: samples of the event on the last level.
    """

    probability: float
    variation: float
    levels: list[tuple[float, float]] = field(default_factory=list)
    runs: int = 0
    event: Samples | None = None

    @property
    def interval(self) -> tuple[float, float]:
        """Bounds of 95 % for a logarithm of the estimate that is normal."""
        if not self.probability:
            return 0.0, SHARE**LEVELS
        spread = NORMAL_95 * sqrt(log(1.0 + self.variation**2))
        return self.probability * exp(-spread), min(1.0, self.probability * exp(spread))


def estimate(evaluate: Evaluate, dimensions: int, *, samples: int, seed: int) -> Estimate:
    """Return the probability that the level of a random sample is at least 1.

    Args:
        evaluate: level of samples.
        dimensions: number of coordinates of a sample.
        samples: on each level; a multiple of 10.
        seed: of all random numbers.
    """
    random = np.random.default_rng(seed)
    chosen = round(SHARE * samples)
    population = _first(evaluate, random, dimensions, samples)
    chains = np.arange(samples)
    result = Estimate(1.0, 0.0, runs=samples)
    for number in range(1, LEVELS + 1):
        order = np.argsort(-population.level, kind="stable")
        hits = int(np.sum(population.level >= EVENT))
        threshold = EVENT if hits >= chosen else float(population.level[order[chosen - 1]])
        reached = population.level >= threshold
        share = float(np.mean(reached))
        result.variation += _variation(reached, chains, share)
        result.probability *= share
        result.levels.append((threshold, share))
        if threshold >= EVENT or share == 1.0:
            done = threshold >= EVENT
            result.probability = result.probability if done else 0.0
            result.event = population.taken(np.flatnonzero(reached)) if done else None
            break
        population, chains = _chains(
            evaluate,
            random,
            population.taken(order[:chosen]),
            threshold,
            samples=samples,
            number=number,
        )
        result.runs += samples - chosen
    else:
        result.probability = 0.0
    return result


def _first(
    evaluate: Evaluate, random: np.random.Generator, dimensions: int, samples: int
) -> Samples:
    """Return independent samples; invalid ones are drawn again."""
    parts: list[Samples] = []
    missing, attempt = samples, 0
    while missing:
        scores = random.standard_normal((missing, dimensions))
        seeds = random.integers(SEEDS, size=missing)
        level = evaluate(f"0-{attempt}", ndtr(scores), seeds)
        part = Samples(scores, seeds, level).taken(np.flatnonzero(level > -np.inf))
        parts.append(part)
        missing, attempt = missing - len(part), attempt + 1
    return joined(parts)


def _chains(
    evaluate: Evaluate,
    random: np.random.Generator,
    starts: Samples,
    threshold: float,
    *,
    samples: int,
    number: int,
) -> tuple[Samples, NDArray[np.int64]]:
    """Return samples on a level by chains from ``starts``, and the number of each one's chain."""
    count, dimensions = starts.scores.shape
    now, states = starts, [starts]
    for step in range(1, samples // count):
        moved = STAY * now.scores + sqrt(1 - STAY**2) * random.standard_normal((count, dimensions))
        fresh = random.integers(SEEDS, size=count)
        seeds = np.where(random.random(count) < RESEED, fresh, now.seeds)
        level = evaluate(f"{number}-{step}", ndtr(moved), seeds)
        stays = level >= threshold
        now = Samples(
            np.where(stays[:, None], moved, now.scores),
            np.where(stays, seeds, now.seeds),
            np.where(stays, level, now.level),
        )
        states.append(now)
    return joined(states), np.tile(np.arange(count), len(states))


def _variation(reached: NDArray[np.bool_], chains: NDArray[np.int64], share: float) -> float:
    """Return the coefficient of variation of a level's share.

    The chains are independent of each other, so that the variance of their means is that of the
    share, whatever the correlation within each.
    """
    if share in (0.0, 1.0):
        return 0.0
    counts = np.bincount(chains)
    means = np.bincount(chains, reached) / counts
    return sqrt(float(np.var(means, ddof=1)) / len(counts)) / share


def pieces(count: int, size: int) -> Iterator[slice]:
    """Yield slices of at most ``size`` that cover ``count``."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))
