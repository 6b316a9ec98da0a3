"""The 14-DOF car drives as a measured one, by numbers that say where they come from."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support import measured_car, measured_fit
from support.measured_car import FIRST, MANOEUVRE, SECOND
from support.measured_fit import UNKNOWNS

from canroll.extensions.car.identification.agreement import agreement
from canroll.extensions.car.identification.pieces import Window
from canroll.vehicles.fit_spread import value_of

SLOW = pytest.mark.slow
MEASURED = (
    "plant.sprung_mass",
    "geometry.cg_to_front_axle",
    "geometry.cg_to_rear_axle",
    "geometry.half_track_front",
    "geometry.half_track_rear",
    "steering.ratio",
    "tyre.radius",
)


@cache
def case():
    return measured_car.case()


@cache
def fitted(window):
    return measured_fit.fit(case().vehicle, case().measured, window)


def shipped():
    """The numbers in the files beside the data, in the order of ``UNKNOWNS``."""
    vehicle, _, mounting = case()
    return np.array(
        [mounting[u.key] if u.of_log else value_of(vehicle, u.key) for u in UNKNOWNS], float
    )


def test_every_number_says_whether_it_was_measured_fitted_or_estimated():
    vehicle = case().vehicle
    assert all(
        text.startswith(("measured", "fitted", "estimate")) for text in vehicle.sources.values()
    )
    assert all(vehicle.source(key).startswith("measured") for key in MEASURED)
    keys = [unknown.key for unknown in UNKNOWNS if not unknown.of_log]
    fitted_keys = [key.removesuffix(".0").removesuffix(".2") for key in keys]
    assert [key for key in fitted_keys if not vehicle.source(key).startswith("fitted on")] == []


def test_measured_numbers_are_those_of_the_testers():
    vehicle = case().vehicle
    assert vehicle.total_mass == pytest.approx(2074.4)
    assert vehicle.geometry.wheelbase == pytest.approx(1.331 + 1.496)
    assert vehicle.steering.ratio == 14.3


@pytest.mark.parametrize("window", [MANOEUVRE, FIRST, SECOND])
def test_the_car_drives_as_measured(window):
    """With the numbers of its file, fitted on all of the manoeuvre."""
    least = (0.9995, 0.996, 0.948, 0.955) if window is MANOEUVRE else (0.995, 0.98, 0.93, 0.94)
    assert (measured_car.agreement(case(), window) > least).all()


@SLOW
def test_the_first_half_predicts_the_second():
    fit = fitted(FIRST)
    ahead = case()._replace(vehicle=fit.vehicle, mounting=fit.mounting)
    assert (measured_car.agreement(ahead, SECOND) > (0.995, 0.98, 0.93, 0.94)).all()


@SLOW
def test_the_numbers_of_the_file_are_those_of_the_fit():
    fit = fitted(MANOEUVRE)
    assert (np.abs(shipped() - fit.values) < 0.2 * fit.deviations).all()


def test_other_numbers_drive_otherwise():
    vehicle = case().vehicle
    softer = replace(vehicle.tyre, cornering_stiffness_rear=0.7 * 362e3)
    other = case()._replace(vehicle=replace(vehicle, tyre=softer))
    assert measured_car.agreement(other, MANOEUVRE)[0] < 0.99


def test_a_fit_recovers_the_numbers_that_made_the_data():
    """Of a drive that the plant itself has made, from other priors."""
    vehicle, measured, mounting = case()
    window = Window(9.3, 11.5)
    made = replace(measured, measured=measured_fit.steered(vehicle, measured, mounting))
    keys = ("tyre.cornering_stiffness_front", "plant.roll_stiffness", "log.roll_offset")
    unknowns = tuple(unknown for unknown in UNKNOWNS if unknown.key in keys)
    delayed = tuple(unknown for unknown in UNKNOWNS if "steering_" in unknown.key)
    fit = measured_fit.fit(vehicle, made, window, unknowns + delayed)
    true = dict(zip((unknown.key for unknown in UNKNOWNS), shipped(), strict=True))
    wanted = [true[unknown.key] for unknown in unknowns + delayed]
    assert fit.values == pytest.approx(wanted, rel=1e-3)


def test_rates_of_the_inertial_unit_are_those_of_the_euler_angles():
    """About the body's axes the pitch rate would have −1 times yaw rate times roll."""
    share, deviation = measured_car.pitch_rate_share(measured_car.DRIVE, MANOEUVRE)
    assert abs(share) < 0.05
    assert deviation < 0.05


@SLOW
def test_lateral_acceleration_of_the_inertial_unit_is_without_gravity():
    fit = measured_car.fitted_with(measured_fit.OF_GRAVITY, case())
    assert abs(fit.values[-1]) < 2 * fit.deviations[-1]
    assert 1.0 - fit.values[-1] > 5 * fit.deviations[-1]


def test_variance_accounted_for_ignores_an_offset_alone():
    measured, every = np.sin(np.linspace(0.0, 7.0, 100)), np.ones(100, bool)

    def explained(simulated):
        return agreement("roll", measured, simulated, measured, every).explained

    assert explained(measured + 1.0) == pytest.approx(1.0)
    assert explained(0.0 * measured) == pytest.approx(0.0)
    assert explained(0.9 * measured) == pytest.approx(0.99)
