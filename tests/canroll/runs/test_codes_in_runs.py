"""In whole runs a fault raises its code in time, and what is no fault raises none."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.firmware.plausibility import (
    FAULT_COMMAND_LATE,
    FAULT_MOTION_CONTRADICTED,
    FAULT_OWN_IDENTIFIER_HEARD,
    FAULT_SAMPLE_RATE_OFF,
    FAULT_SENSOR_ERRATIC,
)
from canroll.firmware.state import ACTIVE, INIT, SAFE
from canroll.runs import experiment

LANE_CHANGE = "double_lane_change"
REVERSED = tuple(
    f"Imu.{name}=reversed@{{start}}" for name in ("RollRate", "LateralAcceleration", "YawRate")
)
BOTH = 1.0
"""Lateral acceleration, m/s², by turning to one side and at once by steering to the other."""


def driven(scenario=LANE_CHANGE, *, over="", **choices):
    """Drive; over a bus that was not designed for, if one is given."""
    settings, controller = experiment.plan(scenario, **choices)
    settings = replace(settings, bus=over or settings.bus)
    return experiment.drive(settings, controller, enabled=True)


def raised(code, trace):
    """Times at which the code is active, s."""
    ticks = trace.ticks
    return np.asarray(ticks["t"][ticks["fault_codes"] >> code & 1 == 1])


def erratic(scenario=LANE_CHANGE, **choices):
    return raised(FAULT_SENSOR_ERRATIC, driven(scenario, backend="native", **choices))


@pytest.mark.slow
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
    times = erratic(faults=[fault], duration=4.0)
    assert 1.0 < times[0] <= 1.0 + latest


@pytest.mark.slow
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
    assert not len(erratic(scenario, bus=bus, conditions={"noise": 2}, **choices))


@pytest.mark.slow
@pytest.mark.parametrize("tick_ms", [5, 20])
def test_other_ticks_are_judged_likewise(tick_ms):
    assert not len(erratic("fishhook", tick_ms=tick_ms, conditions={"noise": 2}))
    times = erratic(faults=["Imu.RollRate=offset:2@1"], tick_ms=tick_ms)
    assert 1.0 < times[0] < 1.05


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["bus=loss:0.2", "VehicleMotion=loss:0.5", "bus=delay:0.03@1"])
def test_lost_and_late_frames_are_not_erratic(fault):
    assert not len(erratic(faults=[fault]))


def late(**choices):
    return raised(FAULT_COMMAND_LATE, driven(duration=2.0, **choices))


@pytest.mark.slow
@pytest.mark.parametrize("trigger", ["event", "every"])
@pytest.mark.parametrize("actuator", ["bars", "suspension"])
def test_a_slower_bus_than_designed_for_is_reported(actuator, trigger):
    # commands begin when INIT is over, after 0.2 s
    assert 0.3 < late(over="gateway_50ms", actuator=actuator, trigger=trigger)[0] < 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    "faults",
    [
        ["AntiRollBarCommand=delay:0.03@1.0", "ActuatorState=delay:0.03@1.0"],
        ["AntiRollBarCommand=delay:0.05@1.0"],
    ],
)
@pytest.mark.parametrize("trigger", ["event", "every"])
def test_ways_of_30_ms_more_each_are_reported(trigger, faults):
    assert 1.03 < late(actuator="bars", trigger=trigger, faults=faults)[0] < 1.25


@pytest.mark.slow
@pytest.mark.parametrize(
    "bus", ["500k", "125k_busy", "fd_2m", "gateway_20ms", "gateway_50ms", "secured_fd"]
)
@pytest.mark.parametrize("trigger", ["event", "every"])
def test_a_bus_that_is_designed_for_is_in_time(bus, trigger):
    assert not len(late(bus=bus, actuator="bars", trigger=trigger))


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["native", "python"])
@pytest.mark.parametrize(
    "fault",
    [
        *("node.RollControl=reset:0.2@1", "node.Actuator=reset:0.2@1"),
        *("AntiRollBarCommand=loss:0.3@0.5", "ActuatorState=loss:0.3@0.5", "bus=loss:0.3@0.5"),
        *("AntiRollBarCommand=loss:1@1:1.2", "ActuatorState=dropout@1:1.2"),
        "AntiRollBarCommand=delay:0.01@0.5",
    ],
)
def test_what_is_lost_or_starts_anew_is_not_late(fault, backend):
    assert not len(late(actuator="bars", faults=[fault], backend=backend))


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["native", "python"])
@pytest.mark.parametrize("kind", ["spoof:800", None])
def test_spoofed_commands_are_heard_within_a_cycle_and_nothing_else_is(kind, backend):
    """A command is answered at once, and sent at least every 50 ms."""
    faults = [f"attacker.AntiRollBarCommand.TorqueFront={kind}@1.2"] if kind else []
    trace = driven(actuator="bars", faults=faults, backend=backend, duration=2.0)
    found = raised(FAULT_OWN_IDENTIFIER_HEARD, trace)
    assert (len(found) > 0) == (kind is not None)
    if kind:
        assert 1.2 < found[0] < 1.2 + 0.07
        assert np.diff(found).max() < 0.011


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "latest"),
    [
        ([], None),
        (["bus=loss:0.1"], None),
        (["bus=error_rate:0.001@1"], None),
        (["node.Imu=clock_drift:0.01@1"], None),
        (["node.Imu=clock_drift:0.03@1"], 4.1),
        (["node.Imu=clock_drift:-0.03@1"], 4.1),
        (["node.Imu=clock_drift:0.3@1"], 1.25),
        (["node.Imu=clock_drift:-0.3@1"], 1.25),
    ],
)
def test_a_clock_that_drifts_is_found_and_nothing_else_is(faults, latest):
    trace = driven(actuator="bars", faults=faults, backend="native", duration=4.5)
    found = raised(FAULT_SAMPLE_RATE_OFF, trace)
    assert (len(found) > 0) == (latest is not None)
    if latest is not None:
        assert 1.0 < found[0] < latest
        assert set(np.unique(trace.ticks["mode"])) <= {INIT, ACTIVE}


@pytest.mark.slow
@pytest.mark.parametrize("tick_ms", [5, 20])
@pytest.mark.parametrize("bus", ["125k_busy", "gateway_50ms"])
def test_other_ticks_and_slow_buses_are_no_other_rate(tick_ms, bus):
    trace = driven(actuator="bars", tick_ms=tick_ms, bus=bus, duration=4.5)
    assert not len(raised(FAULT_SAMPLE_RATE_OFF, trace))


@pytest.mark.parametrize("start", [0.5, 1.6])
def test_a_unit_reversed_as_a_whole_is_found_and_safe(start):
    trace = driven(faults=[fault.format(start=start) for fault in REVERSED])
    assert len(raised(FAULT_MOTION_CONTRADICTED, trace))
    assert trace.ticks["mode"][-1] == SAFE


def test_countersteer_in_a_slide_is_no_fault():
    options = {"friction": 0.52, "chassis_control": False}
    settings, controller = experiment.plan("sine_with_dwell", speed_kmh=108, options=options)
    tyre = settings.vehicle.tyre
    worn = replace(tyre, cornering_stiffness_rear=0.56 * tyre.cornering_stiffness_rear)
    sliding = replace(settings, vehicle=replace(settings.vehicle, tyre=worn))
    trace = experiment.drive(sliding, controller, enabled=True)
    assert steered_against(trace, settings.vehicle) > 0.1
    assert not len(raised(FAULT_MOTION_CONTRADICTED, trace))


def steered_against(trace, vehicle):
    """Time for which the car turns to one side while it is steered to the other, s."""
    speed = trace.signals["vx"]
    turning = speed * trace.signals["yaw_rate"]
    steered = vehicle.lateral_gain(float(speed[0])) * trace.signals["steer"]
    against = (turning * steered < 0) & (np.minimum(abs(turning), abs(steered)) > BOTH)
    return 1e-3 * against.sum()
