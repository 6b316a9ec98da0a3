"""Actuators whose lag, delay and gain are known, drawn by SciPy's linear systems."""

from functools import cache

import numpy as np
import pytest
from scipy.signal import StateSpace, lfilter, lsim
from scipy.stats import binom

from canroll.identification.actuator_fit import Moved, fitted, unknowns_of
from canroll.identification.unknowns import Unknown

STEP = 2.5e-4
LAG = Unknown("actuators.bars.lag", "lag", "s", 0.01, 0.01, 1e-4, 2.0, "usual", positive=True)
DRAWS = 200
NOISE = 30.0


def commands(generator, duration):
    """Moments of a law that follows steering: a random walk through a filter, N·m every 10 ms."""
    return lfilter([0.08], [1.0, -0.92], generator.normal(0.0, 2500.0, round(duration / 0.01)))


def drawn(seed, *, colour=0.0, lag=None, delay=None, duration=20.0, period=0.01, noise=NOISE):
    """Return what was commanded and measured, and the truth: lag, delay and gain."""
    generator = np.random.default_rng(seed)
    lag = generator.uniform(0.01, 0.08) if lag is None else lag
    delay = STEP * generator.integers(0, 200) if delay is None else delay
    gain = generator.uniform(0.8, 1.2)
    command = commands(generator, duration)
    fine = np.repeat(command, round(0.01 / STEP))
    late = round(delay / STEP)
    shifted = np.concatenate((np.full(late, fine[0]), fine))[: fine.size]
    system = StateSpace([[-1 / lag]], [[1 / lag]], [[gain]], [[0.0]])
    time = STEP * np.arange(fine.size)
    _, moment, _ = lsim(system, shifted, time, X0=[fine[0]], interp=False)
    phase = int(generator.integers(0, round(period / STEP)))
    rows = slice(round(1.0 / STEP) + phase, None, round(period / STEP))
    count = len(range(*rows.indices(fine.size)))
    errors = lfilter([np.sqrt(1 - colour**2)], [1, -colour], generator.standard_normal(count))
    measured = moment[rows] + 40.0 + noise * errors
    times = 0.01 * np.arange(command.size)
    return Moved(times, command, time[rows], measured), (lag, delay, gain)


def fit(moved):
    return fitted(moved, unknowns_of(LAG, "front", float(np.std(moved.command))), "front")


@cache
def inside(colour):
    """In how many of the draws the interval of each number holds the truth."""
    hits = np.zeros(3, int)
    for seed in range(DRAWS):
        moved, truth = drawn(seed, colour=colour)
        numbers = fit(moved).numbers[:3]
        away = [abs(n.value - t) / n.deviation for n, t in zip(numbers, truth, strict=True)]
        hits += np.array(away) < 1.96
    return hits


@pytest.mark.parametrize("colour", [0.0, 0.8])
def test_intervals_hold_the_truth_as_often_as_they_say(colour):
    hits = inside(colour)
    # three counts: each outside these limits once in three thousand times, were they right
    least, most = binom.interval(1.0 - 1.0 / 3000.0, DRAWS, 0.95)
    assert hits.min() >= least, hits
    assert hits.max() <= most, hits
