"""Actuators whose lag, delay and gain are known, drawn by SciPy's filters."""

from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from canroll.extensions.car.identification.actuator_fit import Moved, fitted, unknowns_of
from canroll.extensions.car.identification.unknowns import Unknown

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
    time = STEP * np.arange(fine.size)
    # of a command that is constant over a step the exact discretisation is y' = a y + (1 − a) u
    kept = np.exp(-STEP / lag)
    moment = gain * (fine[0] + lfilter([0.0, 1.0 - kept], [1.0, -kept], shifted - fine[0]))
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


@pytest.mark.slow
@pytest.mark.parametrize("colour", [pytest.param(0.0, marks=pytest.mark.long), 0.8])
def test_intervals_hold_the_truth_as_often_as_they_say(colour):
    hits = inside(colour)
    # three counts: each outside these limits once in three thousand times, were they right
    least, most = binom.interval(1.0 - 1.0 / 3000.0, DRAWS, 0.95)
    assert hits.min() >= least, hits
    assert hits.max() <= most, hits


@pytest.mark.slow
def test_samples_rarer_than_the_lag_is_long_tell_lag_and_delay_as_a_pair():
    """Of a lag of 1 ms a sample every 10 ms shows one point of the rise at most."""
    missed = pairs = 0
    for seed in range(40):
        moved, truth = drawn(seed, lag=0.001)
        numbers = fit(moved).numbers[:2]
        pairs += numbers[0].state == "together"
        away = [abs(n.value - t) / n.deviation for n, t in zip(numbers, truth, strict=False)]
        missed += max(away) > 1.96
    assert pairs >= 30, pairs
    assert missed <= 6, missed


def test_samples_rarer_than_the_commands_are_compared_at_their_own_times():
    away = []
    for seed in range(40):
        moved, truth = drawn(seed, period=0.02)
        numbers = fit(moved).numbers[:3]
        away += [abs(n.value - t) / n.deviation for n, t in zip(numbers, truth, strict=True)]
    assert np.mean(np.array(away) < 1.96) > 0.88, away


def test_the_offset_of_a_sensor_is_no_gain():
    moved, (_, _, gain) = drawn(3, noise=1.0)
    fitted_gain, offset = fit(moved).numbers[2:]
    assert offset.value == pytest.approx(40.0, abs=3 * offset.deviation)
    assert fitted_gain.value == pytest.approx(gain, abs=3 * fitted_gain.deviation)
