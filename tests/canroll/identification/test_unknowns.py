"""What a log may tell, with its priors."""

from dataclasses import replace

import numpy as np
import pytest

import vehicles
from canroll.identification.unknowns import unknowns
from vehicles.draws.fitted_cars import values_at
from vehicles.fit_spread import FitSpread


def test_priors_are_distributed_as_the_cars_that_are_drawn_from_a_fit():
    van = vehicles.load("van_real")
    numbers = unknowns(van, ())[:-1]
    names = tuple(number.key for number in numbers)
    deviations = tuple(number.deviation for number in numbers)
    spread = FitSpread("a.csv", names, deviations, ((),))
    scores = np.random.default_rng(1).standard_normal(len(numbers))
    drawn = values_at(replace(van, fit=spread), scores)
    assert drawn == pytest.approx(
        {number.key: number.value(score) for number, score in zip(numbers, scores, strict=True)}
    )
    assert "suspension.roll_stiffness_front_share" in drawn
