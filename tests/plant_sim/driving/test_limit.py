"""What a run was limited by: the car where tyres, wheels or steering are, else the driver."""

import pytest

from canroll import vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.driving.limit import limited_by
from canroll.plant_sim.world.open_loop import run_passive, signals

SEDAN = vehicles.load("sedan_320i")


def limited(vehicle, maneuver, kmh, **options):
    built = maneuvers.build(maneuver, vehicle, kmh / 3.6, **options)
    outputs, steer = run_passive(vehicle, bodies.body("nonlinear"), built)
    return limited_by(vehicle, signals(outputs, steer), built.options["friction"])


@pytest.mark.parametrize(
    ("changes", "kmh", "friction", "reason"),
    [
        ({}, 90.0, 1.0, "rolls over"),
        ({}, 70.0, 0.6, "front tyres are near their peak"),
        ({"steering.rate_limit": 0.05}, 40.0, 1.0, "as fast as it goes"),
        ({"steering.angle_limit": 0.05}, 40.0, 1.0, "at its stop"),
    ],
)
def test_the_car_is_the_limit(changes, kmh, friction, reason):
    vehicle = SEDAN.replace(changes) if changes else SEDAN
    found = limited(vehicle, "moose", kmh, friction=friction, chassis_control=False)
    assert found.by == "car" and reason in found.reason


def test_a_slow_driver_is_the_limit():
    found = limited(SEDAN, "double_lane_change", 80.0, preview_time=2.5)
    assert found.by == "driver" and "% of the grip used" in found.reason
