"""Instructions of the XCP slave per tick on a Cortex-M4."""

import pytest
from support.xcp_machine import VALUES, Machine

from canroll.codegen.run import cortex
from canroll.extensions.services.modules import xcp

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not cortex.has_pip_tools(), reason="needs ziglang and unicorn (canroll[target])"
    ),
]


def test_twenty_values_take_at_most_1500_instructions_a_tick():
    machine = Machine()
    assert machine.tick()[0] < 100
    machine.measure()
    state = machine.ecu.image()
    for _ in range(3):
        count, frames = machine.tick()
        assert count <= 1500
        expected = [bytes([k]) + state[4 * k : 4 * k + 4] for k in range(VALUES)]
        assert frames == expected
    # and a bounded part more while a page is checked
    machine.slave.receive(bytes([xcp.SET_CAL_PAGE, 1, 0, 1]))
    counts = [machine.tick()[0] for _ in range(90)]
    assert max(counts) <= 1500 + 1000
