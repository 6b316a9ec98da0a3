"""An inertial unit reversed as a whole is found; a slide with countersteer is none."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.runs import experiment
from firmware.plausibility import FAULT_MOTION_CONTRADICTED
from firmware.state import SAFE

REVERSED = tuple(
    f"Imu.{name}=reversed@{{start}}" for name in ("RollRate", "LateralAcceleration", "YawRate")
)
BOTH = 1.0
"""Lateral acceleration, m/s², by turning to one side and at once by steering to the other."""


def contradicted(trace):
    """The ticks with the fault code."""
    return (trace.ticks["fault_codes"] >> FAULT_MOTION_CONTRADICTED & 1) == 1


@pytest.mark.parametrize("start", [0.5, 1.6])
def test_a_unit_reversed_as_a_whole_is_found_and_safe(start):
    faults = [fault.format(start=start) for fault in REVERSED]
    planned = experiment.plan("double_lane_change", faults=faults)
    trace = experiment.drive(*planned, enabled=True)
    assert contradicted(trace).any()
    assert trace.ticks["mode"][-1] == SAFE


def test_countersteer_in_a_slide_is_no_fault():
    options = {"friction": 0.52, "chassis_control": False}
    settings, controller = experiment.plan("sine_with_dwell", speed_kmh=108, options=options)
    tyre = settings.vehicle.tyre
    worn = replace(tyre, cornering_stiffness_rear=0.56 * tyre.cornering_stiffness_rear)
    sliding = replace(settings, vehicle=replace(settings.vehicle, tyre=worn))
    trace = experiment.drive(sliding, controller, enabled=True)
    assert steered_against(trace, settings.vehicle) > 0.1
    assert not contradicted(trace).any()


def steered_against(trace, vehicle):
    """Time for which the car turns to one side while it is steered to the other, s."""
    speed = trace.signals["vx"]
    turning = speed * trace.signals["yaw_rate"]
    steered = vehicle.lateral_gain(float(speed[0])) * trace.signals["steer"]
    against = (turning * steered < 0) & (np.minimum(abs(turning), abs(steered)) > BOTH)
    return 1e-3 * against.sum()
