"""What a log may tell, with its priors."""

from dataclasses import replace

import numpy as np
import pytest

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.extensions.car.identification.unknowns import unknowns
from canroll.vehicles.draws.fitted_cars import values_at
from canroll.vehicles.fit_spread import FitSpread


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


def test_what_follows_from_tables_is_held():
    steering = {"steering_wheel [deg]": [-700, 0, 700], "road_wheel [deg]": [-40, 0, 40]}
    damper = {"compression_speed [m/s]": [-1, 0, 1], "force [N]": [-2000, 0, 1000]}
    tables = {"front": {"steering": steering, "damper": damper}, "rear": {"damper": damper}}
    base = {"base": "sedan_320i", "title": "of tables"}
    measured, guessed = (
        [number.key for number in unknowns(vehicles.load(base | more), ())]
        for more in ({"axles": tables}, {})
    )
    assert set(guessed) - set(measured) == {
        "steering.ratio",
        "plant.roll_damping",
        "suspension.roll_damping_front_share",
    }
    with pytest.raises(CanrollError, match=r"steering.ratio follows from axles.front.steering"):
        unknowns(vehicles.load(base | {"axles": tables}), (), free=("steering.ratio",))
