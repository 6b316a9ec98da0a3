"""What the slow balances and the axles' may have left over, against cars of the box."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.gain_gen.monitors.linear_car import axle_forces, car_of
from canroll.gain_gen.monitors.shares import of_axles, of_lateral, of_moments
from canroll.gain_gen.monitors.uncertainty import DEFAULT, Uncertainty, of_vehicle, stated
from canroll.vehicles import GRAVITY, load
from canroll.vehicles.fit_spread import FitSpread
from canroll.vehicles.roll_stiffness import steady_roll

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


@pytest.mark.parametrize("name", ["van_real", "van_2021", "car_2020"])
def test_no_car_of_the_box_has_more_between_its_axles_than_the_shares_in_a_steady_curve(name):
    """Roll of body and axles by the vehicles' own balance of moments, of 300 cars."""
    vehicle = load(name)
    car, random = car_of(vehicle), np.random.default_rng(7)
    by_lateral, by_moment = of_axles(car, DEFAULT)
    lateral, _ = axle_forces(vehicle, car.scale)
    stiffness = car.scale * (np.array(car.shares) * car.stiffness + car.tyres) * [1.0, -1.0]
    largest = np.zeros(2)
    for _ in range(300):
        mass, height, springs, tyre = 1.0 + random.choice([-1.0, 1.0], 4) * [0.2, 0.2, 0.2, 0.1]
        centres = random.choice([-1.0, 1.0], 2) * DEFAULT.roll_centre
        true = 1.0 + random.choice([-1.0, 1.0]) * DEFAULT.moment
        other = replace(
            vehicle,
            plant=replace(
                vehicle.plant,
                sprung_mass=mass * vehicle.plant.sprung_mass,
                cg_height_above_roll_axis=height * vehicle.plant.cg_height_above_roll_axis,
            ),
            tyre=replace(vehicle.tyre, vertical_stiffness=tyre * vehicle.tyre.vertical_stiffness),
            geometry=replace(
                vehicle.geometry,
                roll_centre_height_front=vehicle.geometry.roll_centre_height_front + centres[0],
                roll_centre_height_rear=vehicle.geometry.roll_centre_height_rear + centres[1],
            ),
        )
        suspension = springs * car.stiffness
        free = np.array(steady_roll(other, suspension))
        left = stiffness @ (free[0] - free[1:]) + lateral * (1.0 + GRAVITY * free[0])
        largest[0] = max(largest[0], abs(left) / (1.0 + GRAVITY * free[0]))
        # one that the front actuator passes on, true times what it reports
        moved = np.array(steady_roll(other, suspension, (-true, 0.0))) - free
        left = stiffness @ (moved[0] - moved[1:]) + lateral * GRAVITY * moved[0] - 1.0
        largest[1] = max(largest[1], abs(left))
    assert (largest < 1.02 * np.array([by_lateral, by_moment])).all()
    assert (largest > 0.6 * np.array([by_lateral, by_moment])).all()
