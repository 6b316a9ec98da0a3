"""Vans sized from mass and height, watched for actuators that do not do what they report."""

from dataclasses import replace

import pytest

from canroll.extensions.car.sizing.estimate import estimated
from canroll.firmware.plausibility import FAULT_ACTUATOR_CONTRADICTED
from canroll.firmware.state import SAFE
from canroll.runs.experiment import drive, plan

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("mass", "height", "low_pass"), [(2700.0, 2.5, 0.05), (3500.0, 2.8, 0.1), (5000.0, 3.0, 0.1)]
)
def test_a_heavy_van_is_watched_with_a_longer_low_pass(mass, height, low_pass):
    sizes = {"mass": mass, "wheelbase": 4.3, "track": 1.75, "height": height}
    van = estimated("van", sizes, name="heavy")
    choices = {"vehicle": van, "speed_kmh": 70.0, "actuator": "suspension"}
    settings, controller = plan("double_lane_change", law="lqr", **choices)
    record, roll = controller.record, van.design
    assert record.response_pass == round(0.01 / low_pass * 2**30)
    # the body swings by the roll of 10 m/s², harmonically
    swing = 10.0 * roll.roll_arm / roll.effective_stiffness * roll.natural_frequency
    assert record.response_inertia * 2.0**-10 * swing < 2.0**16
    lie = ("actuators=reversed@1.6 + actuators=lying@1.6",)
    for faults in ((), lie):
        ticks = drive(replace(settings, faults=faults), controller, enabled=True).ticks
        accused = ticks["fault_codes"] >> FAULT_ACTUATOR_CONTRADICTED & 1
        assert accused.any() == (ticks["mode"][-1] == SAFE) == bool(faults)
        assert faults or not ticks["fault_codes"].any()
