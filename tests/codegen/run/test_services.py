"""SecOC beside the loop on a Cortex-M: the same frames as in CPython, within its budget."""

from dataclasses import replace

import pytest

from canroll.codegen.proof.prove import prove
from canroll.codegen.run import cortex, ecu_traffic, memory_image
from canroll.codegen.run.bus_firmware import built_in
from canroll.codegen.run.secured import SecocModule
from canroll.codegen.run.unicorn import CortexEcu
from canroll.codegen.subset.parse import load
from canroll.firmware.calibration import N_RX
from canroll.firmware.security import secoc, secoc_state
from canroll.firmware.security.secoc_state import SECURED
from canroll.firmware.state import N_TX

KEY = bytes(range(16))
BUDGET = {"cortex-m0": 3000, "cortex-m4": 1200}
"""Instructions of a frame. A tick of 10 ms has at most eight, with dampers: three received every
tick and one every second, one reference, a command, and status with diagnostics every tenth."""


def test_it_is_proved():
    assert prove(load("secoc")).findings == ()


@pytest.mark.slow
@pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]")
@pytest.mark.parametrize("cpu", BUDGET)
def test_it_gives_the_same_frames_within_its_budget(cpu):
    firmware = replace(built_in(), services=("secoc",))
    ecu = CortexEcu(ecu_traffic.random_calibration(1), cpu=cpu, count=True, firmware=firmware)
    machine = ecu.machine
    emulated, its = SecocModule(ecu.machine, ecu.firmware), secoc_state.Secoc()
    secoc.start(its, list(KEY), 7, 0)
    emulated.start(KEY, 7, 0)
    for k in range(24):
        frame = [(37 * k + 11 * j) & 255 for j in range(8)] + [0] * 12
        sent = emulated.protect(k % N_TX, bytes(frame))
        assert 0 < machine.instructions <= BUDGET[cpu]
        secoc.protect(its, k % N_TX, frame)
        assert sent == bytes(frame)
        # half of them are another message's, which authenticates nothing
        message = k % N_RX
        expected = secoc.verify(its, message, frame, SECURED)
        assert emulated.verify(message, sent, SECURED) == expected
        assert machine.instructions <= BUDGET[cpu]
    assert emulated.record.image() == memory_image.image(its)
