import numpy as np
import pytest

import vehicles
from canroll.errors import CanrollError, UnknownNameError
from plant_sim import bodies, driver, maneuvers, path, ports, simulate

ROLL1 = bodies.body("roll1")


def test_unknown_names_and_speeds_are_refused():
    van = vehicles.load("van_real")
    with pytest.raises(UnknownNameError, match="did you mean 'roundabout'"):
        maneuvers.build("roundabuot", van)
    for speed in (-5 / 3.6, 0.0, 400 / 3.6, float("nan")):
        with pytest.raises(CanrollError, match="km/h"):
            maneuvers.build("double_lane_change", van, speed)
    with pytest.raises(CanrollError, match="preview"):
        maneuvers.build("double_lane_change", van, preview_time=0.0)


def test_double_lane_change_path_has_the_lanes_of_the_standard():
    x, y = path.double_lane_change(10.0, 3.5, 20.0)
    assert np.interp([0.0, 24.0], x, y) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.interp([56.0, 79.0], x, y) == pytest.approx([3.5, 3.5], abs=1e-4)
    assert np.interp([106.0, 150.0], x, y) == pytest.approx([0.0, 0.0], abs=1e-4)
    assert np.hypot(np.diff(x), np.diff(y)) == pytest.approx(path.STEP, rel=1e-3)


def test_path_from_curvature_closes_a_circle():
    radius = 22.0
    x, y = path.from_curvature([(1e-3, 1 / radius), (2 * np.pi * radius, 1 / radius)])
    assert np.hypot(x - x[0], y - radius).min() == pytest.approx(radius, rel=1e-3)
    assert np.hypot(x[-1], y[-1]) < path.STEP


@pytest.mark.parametrize("name", vehicles.names())
def test_driver_keeps_the_track_below_the_friction_limit(name):
    vehicle = vehicles.load(name)
    for maneuver, off in (("double_lane_change", 0.6), ("roundabout", 0.5)):
        run = maneuvers.build(maneuver, vehicle)
        outputs, steer = simulate.run_passive(vehicle, ROLL1, run)
        assert np.abs(outputs[:, ports.PATH_ERROR]).max() < off
        assert np.abs(outputs[:, ports.AY]).max() < vehicle.tyre.friction * vehicles.GRAVITY
        assert np.abs(outputs[-1, ports.ROLL]) < np.abs(outputs[:, ports.ROLL]).max()
        assert np.abs(np.diff(steer)).max() <= vehicle.steering.rate_limit * 1e-3 + 1e-12


def test_roundabout_is_driven_at_its_radius():
    van = vehicles.load("van_real")
    outputs, _ = simulate.run_passive(van, ROLL1, maneuvers.build("roundabout", van))
    middle = outputs[len(outputs) // 2]
    assert middle[ports.VX] / middle[ports.YAW_RATE] == pytest.approx(22.0, rel=0.05)


def test_same_manoeuvre_gives_the_same_bytes():
    van = vehicles.load("van_real")
    runs = [
        simulate.run_passive(van, ROLL1, maneuvers.build("double_lane_change", van))[0]
        for _ in range(2)
    ]
    assert runs[0].tobytes() == runs[1].tobytes()


def test_sample_interpolates_and_holds_its_ends():
    table = np.array([1.0, 3.0, 2.0])
    assert [driver.sample(table, at) for at in (-1.0, 0.5, 1.5, 9.0)] == [1.0, 2.0, 2.5, 2.0]
