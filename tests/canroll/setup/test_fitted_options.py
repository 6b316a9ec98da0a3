"""Options of a calibration for a vehicle with a spread, and how often its file is read."""

from dataclasses import replace

import pytest

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.setup import controller
from canroll.vehicles.fit_spread import FitSpread


def unsure_of(key):
    """A van of which a fit knows a number to ±120 %."""
    van = vehicles.load("van_real")
    deviation = 0.6 * vehicles.fit_spread.value_of(van, key)
    return replace(van, fit=FitSpread("a.csv", (key,), (deviation,), ((1.0,),)))


def options(vehicle, **choices):
    return controller.options_of({"actuator": "bars", "response_watch": None, **choices}, vehicle)


def test_a_number_that_only_the_watch_of_the_response_needs_may_be_unknown_without_it():
    vehicle = unsure_of("plant.roll_damping")
    with pytest.raises(CanrollError, match=r"knows plant\.roll_damping to ±120 % only"):
        options(vehicle)
    without = options(vehicle, response_watch=False)
    assert without.uncertainty.damping < 1.0


def test_one_that_the_steered_car_needs_may_not():
    with pytest.raises(CanrollError, match=r"knows plant\.roll_stiffness to ±120 % only"):
        options(unsure_of("plant.roll_stiffness"), response_watch=False)


def test_a_width_that_is_given_is_not_asked_of_the_fit():
    given = options(unsure_of("plant.roll_damping"), uncertainty={"damping": "0.4"})
    assert given.uncertainty.damping == 0.4


def test_the_vehicle_of_a_design_is_read_once(monkeypatch):
    read = []
    load = vehicles.load
    monkeypatch.setattr(controller.vehicles, "load", lambda name: read.append(name) or load(name))
    controller.prepare({"vehicle": "van_real", "law": "passive"})
    assert read == ["van_real"]
