"""What the slow balances may have left over, against cars drawn from the box."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.errors import CanrollError
from gain_gen.monitors.shares import of_lateral, of_moments
from gain_gen.monitors.uncertainty import DEFAULT, Uncertainty, of_vehicle, stated
from vehicles import load
from vehicles.fit_spread import FitSpread

BOXES = [DEFAULT, Uncertainty(mass=0.05, height=0.1, stiffness=0.3, moment=0.1)]


def cars(box: Uncertainty) -> tuple[np.ndarray, ...]:
    """Lateral force L, moments M of a law, and what springs show of them, of 20 000 cars."""
    random = np.random.default_rng(3)
    mass, height, stiffness, moment = (
        1.0 + width * random.uniform(-1.0, 1.0, 20_000)
        for width in (box.mass, box.height, box.stiffness, box.moment)
    )
    force = random.uniform(-1.0, 1.0, 20_000)
    reported = -force * random.uniform(0.0, 1.0, 20_000)
    return force, reported, (mass * height * force + moment * reported) / stiffness


@pytest.mark.parametrize("box", BOXES)
def test_no_car_of_the_box_leaves_over_more_than_the_shares_of_force_and_moments(box):
    force, reported, springs = cars(box)
    own, other, besides = of_moments(box)
    left = springs - force - reported
    share = np.where(left * force > 0.0, own, other)
    excess = np.abs(left) - share * np.abs(force) - besides * np.abs(reported)
    assert excess.max() < 1e-12
    # and some car comes near
    assert excess.max() > -0.02


@pytest.mark.parametrize("box", BOXES)
def test_no_car_of_the_box_contradicts_the_acceleration_by_more_than_the_shares(box):
    force, reported, springs = cars(box)
    own, other, besides = of_lateral(box)
    shown = springs - reported
    left = shown - force
    share = np.where(left * shown > 0.0, own, other)
    excess = np.abs(left) - share * np.abs(shown) - besides * np.abs(reported)
    assert excess.max() < 1e-12
    assert excess.max() > -0.02


def fitted(*deviations: float):
    """A van whose roll stiffness and front roll centre were fitted with these deviations."""
    van = load("van_real")
    names = ("plant.roll_stiffness", "geometry.roll_centre_height_front")
    return replace(van, fit=FitSpread("a.csv", names, deviations, ((1.0,), (0.0, 1.0))))


def test_a_fit_that_is_less_sure_than_the_box_widens_it():
    van = load("van_real")
    assert of_vehicle(van) == DEFAULT
    stiffness = van.plant.roll_stiffness
    assert of_vehicle(fitted(0.01 * stiffness, 0.001)) == DEFAULT
    wide = of_vehicle(fitted(0.15 * stiffness, 0.05))
    assert wide == replace(DEFAULT, stiffness=pytest.approx(0.3), roll_centre=0.1)
    assert stated({"stiffness": 0.1}, wide).stiffness == 0.1


def test_a_fit_that_knows_nothing_of_a_number_is_refused_where_it_is_needed():
    unsure = fitted(0.6 * load("van_real").plant.roll_stiffness, 0.04)
    with pytest.raises(CanrollError, match=r"knows plant\.roll_stiffness to ±120 % only") as error:
        of_vehicle(unsure)
    assert str(error.value).endswith("by --uncertainty stiffness=WIDTH")
    assert of_vehicle(unsure, {"roll_centre"}) == replace(DEFAULT, roll_centre=0.08)
