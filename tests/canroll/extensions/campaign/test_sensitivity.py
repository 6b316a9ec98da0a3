"""Sensitivities of known functions, and what tells failures from good draws."""

import numpy as np
import pytest

from canroll.extensions.campaign.sensitivity import first_order, separation


def test_the_indices_of_the_ishigami_function():
    """Ishigami and Homma (1990): a = 7, b = 0.1; the indices are known."""
    x = np.random.default_rng(0).uniform(-np.pi, np.pi, (20_000, 3))
    figure = np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    found = [first_order(column, figure) for column in x.T]
    assert found == pytest.approx([0.3139, 0.4424, 0.0], abs=0.02)


def test_the_index_of_a_choice():
    random = np.random.default_rng(1)
    choice = random.choice(["a", "b"], 4000).astype(object)
    noise = random.standard_normal(4000)
    assert first_order(choice, noise + 2.0 * (choice == "a")) == pytest.approx(0.5, abs=0.03)
    assert first_order(choice, noise) < 0.005


def test_separation_is_the_share_of_ordered_pairs():
    failed, good = np.array([4.0, 5.0, 6.0, 7.0, 8.0]), np.array([1.0, 2.0, 3.0, 4.0, 9.0])
    pairs = [(f > g) + 0.5 * (f == g) for f in failed for g in good]
    assert separation(failed, good) == pytest.approx(np.mean(pairs))
    assert separation(-failed, -good) == pytest.approx(np.mean(pairs))
    assert separation(failed[:4], good) is None
