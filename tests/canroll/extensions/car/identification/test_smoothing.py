"""Smoothing of signals whose noise is known."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from canroll.extensions.car.identification.smoothing import Noise, smoothed

TIME = 0.01 * np.arange(600)
SPEED = 20.0 + 1.5 * np.sin(TIME) - 0.3 * TIME
NOISE = 0.01
NOISY = SPEED + NOISE * np.random.default_rng(1).standard_normal((20, TIME.size))


def test_most_of_the_noise_goes():
    """No more stays than where 24 numbers are fitted to one period: √(24 / 600) of it."""
    left = np.array([smoothed(TIME, noisy)[0] for noisy in NOISY]) - SPEED
    assert np.sqrt(np.mean(left**2)) < 0.2 * NOISE


@pytest.mark.parametrize("noisy", NOISY[:3])
def test_it_is_near_the_cubic_spline_of_the_same_criterion(noisy):
    spline = make_smoothing_spline(TIME, noisy)(TIME)
    assert np.std(smoothed(TIME, noisy)[0] - spline) < 0.02 * np.std(spline - SPEED)


@pytest.mark.parametrize("signal", [np.full(50, 20.0), np.linspace(20.0, 5.0, 50)])
def test_a_straight_line_stays(signal):
    assert smoothed(TIME[:50], signal)[0] == pytest.approx(signal, abs=1e-5)


def test_the_noise_is_that_of_the_samples():
    deviations = [smoothed(TIME, noisy)[1].deviation for noisy in NOISY]
    assert np.mean(deviations) == pytest.approx(NOISE, rel=0.02)


def test_a_signal_without_noise_has_none():
    assert smoothed(TIME, SPEED)[1].deviation < 1e-4 * NOISE


def test_draws_of_the_errors_are_as_large_as_the_errors():
    """Of signals for which the λ was chosen, over the whole time: that of a posterior."""
    generator = np.random.default_rng(4)
    errors, drawn = [], []
    for noisy in NOISY:
        signal, noise = smoothed(TIME, noisy)
        errors.append(signal - SPEED)
        drawn.append(noise.errors(TIME, generator))
    assert np.std(drawn) == pytest.approx(np.std(errors), rel=0.3)


def test_errors_have_the_covariance_of_the_smoothing_matrix():
    count, weight = 8, 3.0
    differences = np.diff(np.eye(count), 2, axis=0)
    expected = 0.25 * np.linalg.inv(np.eye(count) + weight * differences.T @ differences)
    generator = np.random.default_rng(5)
    noise = Noise(0.5, weight, TIME[:count])
    drawn = np.array([noise.errors(noise.times, generator) for _ in range(4000)])
    assert np.cov(drawn.T) == pytest.approx(expected, abs=0.02)
