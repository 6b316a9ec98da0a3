"""Covariances of linear models, whose posterior has a closed form."""

import numpy as np
import pytest

from canroll.identification.information import Information, felt, together

SLOPES = np.random.default_rng(1).standard_normal((40, 3)) * [3.0, 1.0, 0.1]


def information_of(slopes):
    fisher = slopes.T @ slopes
    return Information(fisher, fisher)


def test_with_all_free_it_is_the_posterior():
    information = information_of(SLOPES)
    expected = np.linalg.inv(SLOPES.T @ SLOPES + np.eye(3))
    assert information.covariance(np.ones(3, bool)) == pytest.approx(expected)
    assert information.least(np.ones(3, bool)) == pytest.approx(np.sqrt(np.diag(expected)))


def test_a_held_number_makes_the_others_uncertain_as_draws_do():
    free = np.array([True, True, False])
    covariance = information_of(SLOPES).covariance(free)
    generator = np.random.default_rng(2)
    errors = []
    for _ in range(4000):
        true = generator.standard_normal(3)
        seen = SLOPES @ true + generator.standard_normal(len(SLOPES))
        inner = SLOPES[:, free]
        fitted = np.linalg.solve(inner.T @ inner + np.eye(2), inner.T @ seen)
        errors.append(np.array([*fitted, 0.0]) - true)
    assert covariance == pytest.approx(np.cov(np.array(errors).T), abs=0.06)


def test_what_is_not_felt():
    information = information_of(SLOPES)
    assert felt(information.fisher).tolist() == [True, True, False]
    assert information.directions == 2


def test_strong_correlations_are_named():
    covariance = np.array([[4.0, 1.9, 0.0], [1.9, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert together(covariance, ["a", "b", "c"]) == [("a", "b", pytest.approx(0.95))]
