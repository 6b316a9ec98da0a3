"""Commands that come back late, in whole runs."""

from dataclasses import replace

import pytest

from canroll.runs import experiment
from firmware.plausibility import FAULT_COMMAND_LATE

pytestmark = pytest.mark.slow
FAULTS = (
    "node.RollControl=reset:0.2@1",
    "node.Actuator=reset:0.2@1",
    "AntiRollBarCommand=loss:0.3@0.5",
    "ActuatorState=loss:0.3@0.5",
    "bus=loss:0.3@0.5",
    "AntiRollBarCommand=loss:1@1:1.2",
    "ActuatorState=dropout@1:1.2",
    "AntiRollBarCommand=delay:0.01@0.5",
)


def reported(*, bus="500k", driven_over="", **choices):
    """When the code is active, s, in a run of 2 s; over ``bus`` if no other is driven over."""
    settings, controller = experiment.plan("double_lane_change", bus=bus, duration=2.0, **choices)
    settings = replace(settings, bus=driven_over or bus)
    ticks = experiment.drive(settings, controller, enabled=True).ticks
    return ticks["t"][ticks["fault_codes"] >> FAULT_COMMAND_LATE & 1 == 1]


@pytest.mark.parametrize("trigger", ["event", "every"])
@pytest.mark.parametrize("actuator", ["bars", "suspension"])
def test_a_slower_bus_than_designed_for_is_reported(actuator, trigger):
    found = reported(driven_over="gateway_50ms", actuator=actuator, trigger=trigger)
    # commands begin when INIT is over, after 0.2 s
    assert 0.3 < found[0] < 0.5


@pytest.mark.parametrize(
    "faults",
    [
        ["AntiRollBarCommand=delay:0.03@1.0", "ActuatorState=delay:0.03@1.0"],
        ["AntiRollBarCommand=delay:0.05@1.0"],
    ],
)
@pytest.mark.parametrize("trigger", ["event", "every"])
def test_ways_of_30_ms_more_each_are_reported(trigger, faults):
    found = reported(actuator="bars", trigger=trigger, faults=faults)
    assert 1.03 < found[0] < 1.25


@pytest.mark.parametrize(
    "bus", ["500k", "125k_busy", "fd_2m", "gateway_20ms", "gateway_50ms", "secured_fd"]
)
@pytest.mark.parametrize("trigger", ["event", "every"])
def test_a_bus_that_is_designed_for_is_in_time(bus, trigger):
    assert len(reported(bus=bus, actuator="bars", trigger=trigger)) == 0


@pytest.mark.parametrize("backend", ["native", "python"])
@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_lost_or_starts_anew_is_not_late(fault, backend):
    assert len(reported(actuator="bars", faults=[fault], backend=backend)) == 0
