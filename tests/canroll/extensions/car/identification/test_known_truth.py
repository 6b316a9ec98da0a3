"""Fits of logs whose truth is known: it lies in the stated intervals."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from support import fit_truth

from canroll import vehicles
from canroll.extensions.car.identification.fit import FitSettings, _held
from canroll.extensions.car.identification.unknowns import NUMBERS, unknowns

FREE = (
    "tyre.cornering_stiffness_front",
    "tyre.cornering_stiffness_rear",
    "mass.yaw_inertia",
    "plant.roll_damping",
    "suspension.roll_damping_front_share",
)
HELD = tuple(key for key in NUMBERS if key not in FREE)


@cache
def fitted():
    case = fit_truth.truth(5, duration=4.0, held=HELD)
    return case, fit_truth.fitted(case, FitSettings(starts=1, held=HELD))


def test_the_truth_lies_in_the_intervals():
    case, result = fitted()
    away = {
        n.unknown.key: (n.value - case.numbers[n.unknown.key]) / n.deviation for n in result.numbers
    }
    # of seventeen intervals of 95 % one may miss
    assert sum(abs(deviations) > 1.96 for deviations in away.values()) <= 1, away
    assert max(map(abs, away.values())) < 4.0, away


def test_the_simulation_explains_the_log_and_leaves_noise():
    _, result = fitted()
    assert min(one.explained for one in result.agreements) > 0.97
    for one in result.agreements:
        assert one.rms == pytest.approx(fit_truth.NOISE[one.name], rel=0.2)


def test_the_vehicle_says_how_sure_its_numbers_are():
    case, result = fitted()
    car = result.vehicle
    assert car.source("mass.yaw_inertia").startswith("fitted ±")
    assert car.source("steering.ratio") == case.start.source("steering.ratio")
    again = vehicles.from_table(car.document, name=car.name)
    (prior,) = (u for u in unknowns(again, ()) if u.key == "mass.yaw_inertia")
    (number,) = (n for n in result.numbers if n.unknown.key == "mass.yaw_inertia")
    assert prior.mean == pytest.approx(number.value)
    assert prior.deviation == pytest.approx(number.deviation, rel=0.05)


def test_the_covariance_is_that_of_the_numbers():
    _, result = fitted()
    deviations = [number.deviation for number in result.numbers]
    assert np.sqrt(np.diag(result.covariance)) == pytest.approx(deviations)
    assert np.linalg.eigvalsh(result.covariance / np.outer(deviations, deviations)).min() > -1e-9


def test_held_numbers_may_be_impossible_with_the_others():
    """Then the search begins nearer to the start."""
    feasible = SimpleNamespace(motions=lambda x: None if x.max() > 0.55 else [])
    begin = _held(feasible, np.array([1.0, 2.0]), np.array([True, False]))
    assert begin == pytest.approx([0.5, 0.0])
