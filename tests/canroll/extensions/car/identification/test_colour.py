"""Coloured noise against its draws: AR(1) noise has a known spectrum."""

import numpy as np
import pytest

from canroll.extensions.car.identification.colour import (
    correlation_times,
    misfit_covariance,
    score_covariance,
)


def coloured(generator, count, pole, draws=1):
    noise = generator.standard_normal((draws, count + 200))
    for k in range(1, noise.shape[1]):
        noise[:, k] += pole * noise[:, k - 1]
    return noise[:, 200:]


def test_white_noise_counts_every_sample():
    errors = np.random.default_rng(2).standard_normal((20_000, 2))
    times = correlation_times(errors, np.ones(errors.shape, bool))
    assert times == pytest.approx([1.0, 1.0], abs=0.25)


def test_the_time_of_ar1_noise_is_that_of_its_spectrum():
    errors = coloured(np.random.default_rng(3), 50_000, 0.8)[0][:, None]
    (time,) = correlation_times(errors, np.ones(errors.shape, bool))
    assert time == pytest.approx((1 + 0.8) / (1 - 0.8), rel=0.15)


def test_scores_of_coloured_noise_vary_as_its_draws_do():
    generator = np.random.default_rng(4)
    count, pole = 3000, 0.9
    at = np.arange(count) / count
    weights = np.column_stack([np.sin(2 * np.pi * 3 * at), np.ones(count)])[:, None, :]
    draws = coloured(generator, count, pole, 400)
    expected = np.cov((draws @ weights[:, 0, :]).T)
    errors = draws[0][:, None]
    found = np.mean(
        [
            score_covariance(weights, draw[:, None], np.ones(errors.shape, bool))
            for draw in draws[:60]
        ],
        axis=0,
    )
    assert np.diag(found) == pytest.approx(np.diag(expected), rel=0.2)


def test_signals_that_err_together_are_one():
    errors = np.random.default_rng(5).standard_normal((5000, 1)) @ np.ones((1, 2))
    weights = np.ones((5000, 2, 1))
    found = score_covariance(weights, errors, np.ones(errors.shape, bool))
    apart = score_covariance(weights[:, :1], errors[:, :1], np.ones((5000, 1), bool))
    assert found == pytest.approx(4 * apart)


def test_a_misfit_does_not_average_out():
    """A model without a bend that the car has: its line is off by more than noise has it."""
    generator = np.random.default_rng(6)
    at = np.linspace(-1.0, 1.0, 600)
    slopes = np.column_stack([at, np.sin(3.0 * at)])
    inverse = np.linalg.inv(slopes.T @ slopes)
    noise, off, far = 0.05, [], []
    for _ in range(300):
        bend = generator.normal(0.0, 0.1) * np.sin(generator.uniform(4.0, 12.0) * at)
        seen = bend + noise * generator.standard_normal(at.size)
        fitted = inverse @ slopes.T @ seen
        errors, every = (slopes @ fitted - seen)[:, None], np.ones((at.size, 1), bool)
        scores = score_covariance(slopes[:, None], errors, every)
        misfit = misfit_covariance(slopes[:, None], errors, every)
        if misfit.any():
            off.append(fitted / np.sqrt(np.diag(inverse @ scores @ inverse)))
            far.append(fitted / np.sqrt(np.diag(inverse @ (scores + misfit) @ inverse)))
    assert len(far) > 100
    assert np.mean(np.abs(off) < 1.96) < 0.8
    assert np.mean(np.abs(far) < 1.96) > 0.9


def test_white_residuals_have_no_misfit():
    errors = np.random.default_rng(7).standard_normal((800, 2))
    assert not misfit_covariance(np.ones((800, 2, 3)), errors, np.ones((800, 2), bool)).any()
