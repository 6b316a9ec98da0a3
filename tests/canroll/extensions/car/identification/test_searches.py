"""What a fit says of the minima in which its searches ended, and when it searches on."""

from types import SimpleNamespace

import numpy as np
import pytest

from canroll.extensions.car.identification import fit as fits
from canroll.extensions.car.identification.agreement import Agreement
from canroll.extensions.car.identification.fit import ROUNDS, FitSettings, _searched
from canroll.extensions.car.identification.output_error import Point


def remarks(minima, *, white):
    agreement = Agreement("yaw_rate", 0.998, 0.0076, 0.0 if white else 0.21, white, 0.7)
    return list(_searched(minima, (agreement,)))


WORSE = "{} of 3 searches ended in a worse minimum: the best is taken"


@pytest.mark.parametrize(
    ("minima", "white", "lines"),
    [
        # of a log of known truth: the search that found it ended at a cost of 113.1
        ((860.1, 627.7, 15103.5), False, ["the fit did not converge to the noise"]),
        # a search alone is confirmed by noise only
        ((627.7,), False, ["the fit did not converge to the noise"]),
        ((627.7,), True, []),
        ((860.1, 627.7, 113.1), True, [WORSE.format(2)]),
        # another search confirms it
        ((860.1, 627.7, 628.9), False, [WORSE.format(1)]),
        ((627.7, 628.9), False, []),
    ],
)
def test_a_best_minimum_is_confirmed_by_noise_or_by_another_search(minima, white, lines):
    texts = remarks(minima, white=white)
    assert [text.partition(": the residuals")[0] for text in texts] == lines


def test_the_advice_is_one_round_of_as_many_searches_as_there_were():
    """Of which there are up to four times as many again."""
    (line,) = remarks(tuple(100.0 * 2.0**k for k in range(12)), white=False)
    assert line.endswith("give --starts 12")


@pytest.mark.parametrize(
    ("starts", "costs", "white", "expected"),
    [
        # as many more as there were, until one is confirmed
        (3, (860.1, 627.7, 15103.5, 627.7, 900.0, 950.0), False, 6),
        (3, (860.1, 627.7, 113.1), True, 3),
        (3, (627.7, 627.7, 900.0), False, 3),
        (3, tuple(100.0 * 2.0**k for k in range(50)), False, 3 * ROUNDS),
        (1, (627.7, 628.9, 113.1), False, 2),
        (1, (627.7, 113.1), True, 1),
    ],
)
def test_a_doubtful_minimum_is_searched_for_again(monkeypatch, starts, costs, white, expected):
    left, refinements = iter(costs), []
    agreement = Agreement("yaw_rate", 0.998, 0.0076, 0.21, white, 0.7)
    monkeypatch.setattr(fits, "starts", lambda model, count, seed: iter(np.zeros((count, 1))))
    monkeypatch.setattr(fits, "searched", lambda simulator, x: Point(x, next(left), x))
    monkeypatch.setattr(fits, "refined", lambda simulator, p: refinements.append(p.cost) or p)
    monkeypatch.setattr(fits, "_agreements", lambda model, x: (agreement,))
    point, minima = fits._best(SimpleNamespace(model=None), FitSettings(starts=starts))
    assert minima == costs[:expected]
    assert point.cost == min(minima)
    assert refinements == [min(minima)]
