"""A steady circle: gradients by hand, and the band by its geometry."""

import numpy as np
import pytest

from canroll import vehicles
from canroll.extensions.car.identification.pieces import EVERYTHING
from canroll.extensions.car.validation.measurement import NONE
from canroll.extensions.car.validation.replayed import replayed
from canroll.extensions.car.validation.steady_circle import boundaries, distances, judge
from canroll.extensions.car.validation.tolerances import TOLERANCES, Tolerance
from canroll.plant_sim import bodies
from canroll.plant_sim.world import handling
from tests.support.measured_drives import driven, log_of, ramp, time_of

GRAVITY = 9.81
SPEED, K_STEER, K_SLIP, K_ROLL = 20.0, 0.0031, 0.0042, 0.0067
"""Speed (m/s) and gradients (rad s²/m) of the car in the log."""


def circle(lateral):
    """The columns of a linear car: δ = l/R + K a_y, β = l_r/R − K_β a_y, φ = K_φ a_y."""
    car = vehicles.load("van_real")
    curvature = lateral / SPEED**2
    return {
        "steering": car.steering.ratio * (car.geometry.wheelbase * curvature + K_STEER * lateral),
        "speed": np.full(len(lateral), SPEED),
        "yaw_rate": lateral / SPEED,
        "lateral_acceleration": lateral,
        "roll_rate": K_ROLL * np.gradient(lateral, 0.01),
        "roll": K_ROLL * lateral,
        "sideslip": car.geometry.cg_to_rear_axle * curvature - K_SLIP * lateral,
    }


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_measured_gradients_are_those_of_the_log(side):
    lateral = side * 0.15 * time_of(45.0)
    log = log_of(circle(lateral))
    drive = replayed(log, vehicles.load("van_real"), EVERYTHING, "body", NONE)
    figures = {one.label: one for one in judge(drive, TOLERANCES).criteria}
    expected = {"understeer": K_STEER, "sideslip": -K_SLIP, "roll": K_ROLL}
    for name, gradient in expected.items():
        figure = figures[f"{name} gradient"]
        assert figure.measured == pytest.approx(np.degrees(gradient) * GRAVITY, rel=2e-3)
        assert figure.unit == "°/g"
        assert figure.tolerance == np.inf


def test_of_a_steering_with_a_table_the_road_wheels_make_the_gradient():
    lateral = 0.15 * time_of(45.0)
    columns, car = circle(lateral), vehicles.load("van_real")
    # a rack that is quicker beyond 30 degrees of the steering wheel
    wheel, road = np.array([-12.0, -0.5, 0.5, 12.0]), np.array([-1.0, -0.028, 0.028, 1.0])
    columns["steering"] = np.interp(columns["steering"] / car.steering.ratio, road, wheel)
    table = {"steering_wheel [rad]": wheel.tolist(), "road_wheel [rad]": road.tolist()}
    given = {"base": "van_real", "title": "quick", "axles": {"front": {"steering": table}}}
    drive = replayed(log_of(columns), vehicles.load(given), EVERYTHING, "body", NONE)
    figures = {one.label: one for one in judge(drive, TOLERANCES).criteria}
    figure = figures["understeer gradient"]
    assert figure.measured == pytest.approx(np.degrees(K_STEER) * GRAVITY, rel=2e-3)


def test_gradients_of_a_simulated_car_are_those_of_a_driven_circle():
    """ISO 4138 with a driver on a radius of 100 m, up to 3 m/s²."""
    car = vehicles.load("van_real")
    other = handling.constant_radius(
        car, handling.passive(car, bodies.body("nonlinear")), radius=100.0
    )
    log = log_of(driven(car, ramp(1.8), 18.0))
    drive = replayed(log, car, EVERYTHING, "body", NONE)
    figures = {one.label: one.simulated for one in judge(drive, TOLERANCES).criteria}
    assert figures["understeer gradient"] == pytest.approx(other.gradient, abs=0.15)
    assert figures["roll gradient"] == pytest.approx(other.roll_gradient, rel=0.03)


FLAT = Tolerance(0.5, 0.0, "", "")
TALL = Tolerance(2.0, 0.0, "", "")


def test_the_band_of_a_level_line_is_its_height():
    x = np.linspace(0.0, 10.0, 11)
    lower, upper = boundaries(x, np.zeros(11), FLAT, TALL)
    assert lower[1] == pytest.approx(-2.0)
    assert upper[1] == pytest.approx(2.0)
    assert upper[0] == pytest.approx(x)


def test_the_band_of_a_slope_is_the_envelope_of_ellipses():
    """y = s x: the tangent of slope s to an ellipse lies √(b² + (s a)²) above its centre."""
    x, slope = np.linspace(0.0, 10.0, 11), 3.0
    _, upper = boundaries(x, slope * x, FLAT, TALL)
    height = np.sqrt(2.0**2 + (slope * 0.5) ** 2)
    assert upper[1] - slope * upper[0] == pytest.approx(height)


def test_points_on_the_boundary_are_one_tolerance_away():
    x = np.linspace(0.0, 10.0, 11)
    line = x, 0.3 * x**2
    _, upper = boundaries(*line, FLAT, TALL)
    inner = slice(2, -2)
    points = upper[0][inner], upper[1][inner]
    assert distances(points, line, FLAT, TALL) == pytest.approx(1.0, abs=0.02)
    assert distances(line, line, FLAT, TALL) == pytest.approx(0.0, abs=1e-9)


def test_a_tolerance_grows_with_the_value():
    grown = Tolerance(0.2, 0.05, "°", "")
    assert grown.of(-0.4) == pytest.approx(np.radians(0.2) + 0.02)


def test_beyond_the_ends_the_distance_is_that_of_the_last_ellipse():
    line = np.array([1.0, 2.0]), np.array([0.0, 0.0])
    assert distances((np.array([3.0]), np.zeros(1)), line, FLAT, TALL) == pytest.approx(2.0)
