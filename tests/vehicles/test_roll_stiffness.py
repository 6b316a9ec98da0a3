"""Vehicles of a population whose roll stiffness is below that of the nominal springs."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.bodies.parameters import build_parameters
from canroll.vehicles import load
from canroll.vehicles.roll_stiffness import springs_within


def test_springs_are_softened_no_more_than_needed():
    nominal = load("suv_2020")
    softer = replace(
        nominal, plant=replace(nominal.plant, roll_stiffness=0.75 * nominal.plant.roll_stiffness)
    )
    with pytest.raises(CanrollError, match="spring_rate_rear"):
        build_parameters(softer)
    possible = springs_within(softer)
    assert possible.suspension.spring_rate_front == nominal.suspension.spring_rate_front
    assert possible.suspension.spring_rate_rear < nominal.suspension.spring_rate_rear
    stiffer = replace(
        possible,
        suspension=replace(
            possible.suspension, spring_rate_rear=1.001 * possible.suspension.spring_rate_rear
        ),
    )
    with pytest.raises(CanrollError, match="spring_rate_rear"):
        build_parameters(stiffer)


def test_springs_that_fit_stay_as_they_are():
    nominal = load("suv_2020")
    assert springs_within(nominal) is nominal


@pytest.mark.parametrize("share", np.linspace(0.4, 0.7, 30))
def test_rounding_makes_no_spring_too_stiff(share):
    car = load("van_real")
    springs = dict.fromkeys(("spring_rate_front", "spring_rate_rear"), 1e6)
    stiff = replace(car.suspension, roll_stiffness_front_share=float(share), **springs)
    build_parameters(springs_within(replace(car, suspension=stiff)))
