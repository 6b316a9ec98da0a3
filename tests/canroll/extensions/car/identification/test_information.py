"""Covariances of linear models, whose posterior has a closed form."""

import numpy as np
import pytest

from canroll.extensions.car.identification.information import (
    Information,
    felt,
    numbers_at,
    together,
)
from canroll.extensions.car.identification.unknowns import Unknown

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


def test_a_misfit_leaves_numbers_at_most_as_uncertain_as_before():
    free, fisher = np.ones(3, bool), SLOPES.T @ SLOPES
    noise = Information(fisher, fisher).covariance(free)
    for size in (1.0, 1e3, 1e9):
        covariance = Information(fisher, fisher, misfit=size * fisher).covariance(free)
        assert np.linalg.eigvalsh(covariance).max() < 1.0 + 1e-9
        assert np.linalg.eigvalsh(covariance - noise).min() > -1e-9
    assert np.diag(covariance) == pytest.approx(1.0)


def test_a_number_at_its_bound_is_not_identified():
    share = Unknown("suspension.roll_stiffness_front_share", "", "", 0.5, 0.1, 0.1, 0.9, "")
    for x, state in ((4.0, "bound"), (-4.0, "bound"), (3.9, "identified")):
        (number,) = numbers_at([share], np.array([x]), np.full((1, 1), 0.01), np.ones(1, bool))
        assert number.state == state
