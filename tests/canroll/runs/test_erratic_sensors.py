"""Jumping and noisy sensors in whole runs."""

import numpy as np
import pytest

from canroll.runs import experiment
from firmware.plausibility import FAULT_SENSOR_ERRATIC

pytestmark = pytest.mark.slow


def reported(scenario, **choices):
    """Times at which the code is active, s."""
    settings, controller = experiment.plan(scenario, backend="native", **choices)
    ticks = experiment.drive(settings, controller, enabled=True).ticks
    return np.asarray(ticks["t"][ticks["fault_codes"] >> FAULT_SENSOR_ERRATIC & 1 == 1])


@pytest.mark.parametrize(
    ("fault", "latest"),
    [
        ("Imu.RollRate=offset:0.3@1", 0.03),
        ("Imu.RollRate=burst:0.3@1:3", 0.08),
        ("Imu.LateralAcceleration=offset:-9@1", 0.04),
        ("Imu.LateralAcceleration=burst:3@1:3", 0.08),
        ("Imu.YawRate=spike:0.2@1:3", 0.13),
        ("VehicleMotion.VehicleSpeed=offset:8@1", 0.07),
        ("VehicleMotion.VehicleSpeed=scale:0.5@1", 0.07),
        ("VehicleMotion.SteeringWheelAngle=burst:1@1:3", 0.15),
    ],
)
def test_what_no_car_can_do_is_reported_at_once(fault, latest):
    times = reported("double_lane_change", faults=[fault], duration=4.0)
    assert 1.0 < times[0] <= 1.0 + latest


@pytest.mark.parametrize("bus", ["500k", "gateway_50ms"])
@pytest.mark.parametrize(
    ("scenario", "choices"),
    [
        ("fishhook", {"vehicle": "suv_2020"}),
        ("bumps", {"vehicle": "suv_2020", "options": {"height": 0.06}}),
        ("random_road", {"vehicle": "car_2020", "options": {"road_class": "C"}}),
        ("j_turn", {"vehicle": "van_real"}),
    ],
)
def test_manoeuvres_roads_and_noise_are_not_erratic(scenario, choices, bus):
    assert not len(reported(scenario, bus=bus, conditions={"noise": 2}, **choices))


@pytest.mark.parametrize("tick_ms", [5, 20])
def test_other_ticks_are_judged_likewise(tick_ms):
    assert not len(reported("fishhook", tick_ms=tick_ms, conditions={"noise": 2}))
    times = reported("double_lane_change", faults=["Imu.RollRate=offset:2@1"], tick_ms=tick_ms)
    assert 1.0 < times[0] < 1.05


@pytest.mark.parametrize("fault", ["bus=loss:0.2", "VehicleMotion=loss:0.5", "bus=delay:0.03@1"])
def test_lost_and_late_frames_are_not_erratic(fault):
    assert not len(reported("double_lane_change", faults=[fault]))
