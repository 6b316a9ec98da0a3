"""Commands that an attacker sends in the ECU's name, in whole runs."""

import numpy as np
import pytest

from canroll.runs import experiment
from firmware.plausibility import FAULT_OWN_IDENTIFIER_HEARD

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("backend", ["native", "python"])
@pytest.mark.parametrize("kind", ["spoof:800", None])
def test_spoofed_commands_are_heard_within_a_cycle_and_nothing_else_is(kind, backend):
    """A command is answered at once, and sent at least every 50 ms."""
    faults = [f"attacker.AntiRollBarCommand.TorqueFront={kind}@1.2"] if kind else []
    settings, controller = experiment.plan(
        "double_lane_change", actuator="bars", faults=faults, backend=backend, duration=2.0
    )
    ticks = experiment.drive(settings, controller, enabled=True).ticks
    found = ticks["t"][ticks["fault_codes"] >> FAULT_OWN_IDENTIFIER_HEARD & 1 == 1]
    assert (len(found) > 0) == (kind is not None)
    if kind:
        assert 1.2 < found[0] < 1.2 + 0.07
        assert np.diff(found).max() < 0.011
