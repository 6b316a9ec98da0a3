"""Cars drawn from a fit: joint distribution as in the table, impossible tables refused."""

import numpy as np
import pytest
import tomli_w
from scipy.stats import chi2, kstest

from canroll import vehicles
from canroll.errors import CanrollError
from canroll.vehicles.draws.fitted_cars import draws
from canroll.vehicles.fit_spread import value_of

NAMES = ("plant.roll_stiffness", "mass.yaw_inertia", "geometry.roll_centre_height_front")
DEVIATIONS = (20000.0, 150.0, 0.02)
CORRELATION = ((1.0,), (0.8, 1.0), (-0.5, -0.1, 1.0))


def table(**changes):
    rows = [list(row) for row in CORRELATION]
    fit = {"log": "a.csv", "names": list(NAMES), "deviations": list(DEVIATIONS)}
    fit = fit | {"correlation": rows} | changes
    return vehicles.load("van_real").document | {"fit": fit}


def fitted(**changes):
    return vehicles.from_table(table(**changes), name="van")


def test_draws_have_the_covariance_of_the_table():
    vehicle = fitted()
    cars = draws(vehicle, 2000)
    assert {car.fit for car in cars} == {None}
    numbers = np.array([[value_of(car, name) for name in NAMES] for car in cars])
    fitted_at = np.array([value_of(vehicle, name) for name in NAMES])
    deviations = np.array(DEVIATIONS)
    scores = (numbers - fitted_at) / deviations
    scores[:, :2] = np.log(numbers[:, :2] / fitted_at[:2]) / (deviations / fitted_at)[:2]
    correlation = np.array([[1.0, 0.8, -0.5], [0.8, 1.0, -0.1], [-0.5, -0.1, 1.0]])
    # three standard deviations of a variance from 2000 draws
    assert np.cov(scores.T) == pytest.approx(correlation, abs=3 * (2 / 2000) ** 0.5)
    distances = np.einsum("ni,ij,nj->n", scores, np.linalg.inv(correlation), scores)
    assert kstest(distances, chi2(3).cdf).pvalue > 0.01


def test_draws_depend_on_the_seed_and_a_vehicle_without_a_fit_has_none():
    vehicle = fitted()
    assert draws(vehicle, 3) == draws(vehicle, 5)[:3]
    assert draws(vehicle, 3, seed=2) != draws(vehicle, 3)
    assert draws(vehicles.load("van_real")) == ()


def test_a_draw_that_is_no_car_is_drawn_again():
    wide = fitted(
        names=["suspension.roll_stiffness_front_share"], deviations=[0.5], correlation=[[1.0]]
    )
    shares = [car.suspension.roll_stiffness_front_share for car in draws(wide, 200)]
    assert 0.0 < min(shares) < 0.2
    assert 0.8 < max(shares) < 1.0


def test_the_table_survives_its_file_and_is_part_of_the_fingerprint():
    vehicle = fitted()
    assert vehicles.load(vehicle).fit == vehicle.fit
    assert vehicle.fingerprint != vehicles.load("van_real").fingerprint


def test_a_number_that_is_given_is_not_of_the_fit_any_more():
    changed = fitted().replace({"mass.yaw_inertia": 9300.0})
    assert changed.fit.names == (NAMES[0], NAMES[2])
    assert changed.fit.deviations == pytest.approx((DEVIATIONS[0], DEVIATIONS[2]))
    assert changed.fit.correlation == ((1.0,), (pytest.approx(-0.5), 1.0))
    given = {"plant.roll_stiffness": 190000.0, "geometry.roll_centre_height_front": 0.1}
    assert changed.replace(given).fit is None


def test_a_short_file_keeps_the_fit_of_its_base_but_for_its_own_numbers(tmp_path):
    (tmp_path / "fitted.toml").write_text(tomli_w.dumps(table()))
    short = tmp_path / "short.toml"
    short.write_text('base = "fitted.toml"\n[mass]\nyaw_inertia = 9300.0\n')
    assert vehicles.load(short).fit.names == (NAMES[0], NAMES[2])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"log": ""}, "fit.log must be a string"),
        ({"names": []}, "fit.names must be a list of keys"),
        ({"names": [NAMES[0]] * 3}, "fit.names: each once"),
        (
            {"names": [*NAMES[:2], "plant.colour"]},
            "fit.names: the vehicle has no number 'plant.col",
        ),
        ({"names": [*NAMES[:2], "lane_offset"]}, "van: fit.names: the vehicle has no number 'lane"),
        ({"names": [*NAMES[:2], "fit.deviations.0"]}, "the vehicle has no number 'fit.dev"),
        (
            {"names": [*NAMES[:2], "sensors.imu_position.-1"]},
            "fit.names: the vehicle has no number 'sensors.imu_position.-1'",
        ),
        ({"names": [*NAMES[:2], "plant"]}, "fit.names: the vehicle has no number 'plant'"),
        (
            {"names": [*NAMES[:2], "plant.natural_frequency"]},
            "fit.names: the vehicle has no number 'plant.natural_frequency'",
        ),
        ({"deviations": [1.0, 2.0]}, "fit.deviations must be 3 positive numbers"),
        ({"deviations": [1.0, 0.0, 2.0]}, "fit.deviations must be 3 positive numbers"),
        ({"correlation": [[1.0], [0.8, 1.0]]}, "fit.correlation must be 3 rows"),
        ({"correlation": [[1.0], [0.8, 1.0], [0.0, 0.0, 2.0]]}, "each row must end in 1"),
        (
            {"correlation": [[1.0], [0.9, 1.0], [-0.9, 0.9, 1.0]]},
            "fit.correlation is not positive definite",
        ),
        ({"seed": 1}, "unknown key of van: [fit] 'seed'"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(changes, message):
    with pytest.raises(CanrollError) as error:
        vehicles.from_table(table(**changes), name="van", where="van")
    assert message in str(error.value)
    assert "\n" not in str(error.value)
