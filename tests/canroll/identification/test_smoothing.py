"""Smoothing of signals whose noise is known."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from canroll.identification.smoothing import smoothed

TIME = 0.01 * np.arange(600)
SPEED = 20.0 + 1.5 * np.sin(TIME) - 0.3 * TIME
NOISE = 0.01
NOISY = SPEED + NOISE * np.random.default_rng(1).standard_normal((20, TIME.size))


def test_most_of_the_noise_goes():
    """No more stays than where 24 numbers are fitted to one period: √(24 / 600) of it."""
    left = np.array([smoothed(noisy) for noisy in NOISY]) - SPEED
    assert np.sqrt(np.mean(left**2)) < 0.2 * NOISE


@pytest.mark.parametrize("noisy", NOISY[:3])
def test_it_is_near_the_cubic_spline_of_the_same_criterion(noisy):
    spline = make_smoothing_spline(TIME, noisy)(TIME)
    assert np.std(smoothed(noisy) - spline) < 0.02 * np.std(spline - SPEED)


@pytest.mark.parametrize("signal", [np.full(50, 20.0), np.linspace(20.0, 5.0, 50)])
def test_a_straight_line_stays(signal):
    assert smoothed(signal) == pytest.approx(signal, abs=1e-5)
