"""What a fit says of the minima in which its searches ended."""

from canroll.identification.agreement import Agreement
from canroll.identification.fit import _searched


def told(minima, *, white):
    agreement = Agreement("yaw_rate", 0.998, 0.0076, 0.0 if white else 0.21, white, 0.7)
    return list(_searched(minima, (agreement,)))


def test_a_best_minimum_that_no_other_search_confirms_is_doubted():
    """A log of known truth: the search that found it ended at a cost of 113.1."""
    (line,) = told((860.1, 627.7, 15103.5), white=False)
    assert line.startswith("the fit did not converge to the noise")
    assert line.endswith("give --starts 12")


def test_noise_confirms_a_minimum():
    (line,) = told((860.1, 627.7, 113.1), white=True)
    assert line == "2 of 3 searches ended in a worse minimum: the best is taken"


def test_another_search_confirms_a_minimum():
    (line,) = told((860.1, 627.7, 628.9), white=False)
    assert line == "1 of 3 searches ended in a worse minimum: the best is taken"


def test_searches_that_agree_say_nothing():
    assert told((627.7, 628.9), white=False) == []
    assert told((627.7,), white=False) == []
