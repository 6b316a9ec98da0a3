"""Campaigns with a fitted vehicle: its numbers are drawn together, as its file says."""

from math import asin, pi

import numpy as np
import pytest
from scipy.stats import kstest, lognorm, norm, spearmanr

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.extensions.campaign import campaign_file
from canroll.studies import variation

STIFFNESS, HEIGHT = "plant.roll_stiffness", "geometry.roll_centre_height_front"


@pytest.fixture(scope="module")
def vehicle():
    fit = {
        "log": "a.csv",
        "names": [STIFFNESS, HEIGHT],
        "deviations": [17800.0, 0.03],
        "correlation": [[1.0], [0.7, 1.0]],
    }
    document = vehicles.load("van_real").document | {"fit": fit}
    return vehicles.from_table(document, name="van_real")


def planned(vehicle, *stated, runs=400):
    return campaign_file.of_options(
        "roundabout",
        {"law": "plain_feedforward", "plant": "nonlinear", "vehicle": vehicle},
        runs=runs,
        seed=3,
        spread=variation.spread_from(dict.fromkeys(stated, 0.1)),
        buses=[],
        faults=[],
        stated=stated,
    ).plan()


@pytest.mark.slow
def test_cars_are_drawn_from_the_joint_spread_of_the_fit(vehicle):
    plan = planned(vehicle)
    assert set(plan.space.names) == {
        f"fit.{STIFFNESS}",
        f"fit.{HEIGHT}",
        "condition.estimate_error",
    }
    settings = [each for chunk in range(plan.chunks) for each in plan.draws(chunk)[1]]
    stiffness = np.array([each.vehicle.plant.roll_stiffness for each in settings])
    height = np.array([each.vehicle.geometry.roll_centre_height_front for each in settings])
    nominal = vehicle.geometry.roll_centre_height_front
    assert kstest(stiffness, lognorm(17800.0 / 178000.0, scale=178000.0).cdf).pvalue > 0.01
    assert kstest(height, norm(nominal, 0.03).cdf).pvalue > 0.01
    # Spearman's coefficient of two normal variables that have Pearson's 0.7
    rank = 6.0 / pi * asin(0.7 / 2.0)
    assert spearmanr(stiffness, height).statistic == pytest.approx(rank, abs=0.06)
    for each in settings:
        assert each.vehicle.fit is None
        assert each.vehicle.design == vehicle.design
        assert each.vehicle.mass == vehicle.mass


def test_what_the_fit_does_not_have_can_be_drawn_too(vehicle):
    assert "vehicle.sprung_mass" in planned(vehicle, "sprung_mass", runs=4).space.names


def test_a_number_of_the_fit_is_not_drawn_twice(vehicle):
    with pytest.raises(CanrollError, match=r"vehicle.roll_stiffness is drawn from \[fit\]"):
        planned(vehicle, "roll_stiffness", runs=4)
