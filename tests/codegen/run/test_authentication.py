"""SecOC beside the loop on a Cortex-M: the same frames as in CPython, within its budget."""

from dataclasses import replace

import pytest

from codegen.proof.prove import prove
from codegen.run import cortex, ecu_traffic, memory_image
from codegen.run.bus_firmware import built_in
from codegen.run.unicorn import PAYLOAD, CortexEcu
from codegen.subset.parse import load
from firmware.calibration import N_RX
from firmware.security import secoc
from firmware.security.secoc_state import SECURED, Secoc
from firmware.state import N_TX

RECORD = 0x20008000
KEY = bytes(range(16))
BUDGET = {"cortex-m0": 3000, "cortex-m4": 1200}
"""Instructions of a frame. A tick of 10 ms has at most eight, with dampers: three received every
tick and one every second, one reference, a command, and status with diagnostics every tenth."""


def test_it_is_proved():
    assert prove(load("secoc")).findings == ()


@pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]")
@pytest.mark.parametrize("cpu", BUDGET)
def test_it_gives_the_same_frames_within_its_budget(cpu):
    firmware = replace(built_in(), services=("secoc",))
    ecu = CortexEcu(ecu_traffic.random_calibration(1), cpu=cpu, count=True, firmware=firmware)
    its = Secoc()
    secoc.start(its, list(KEY), 7, 0)
    ecu._machine.mem_write(PAYLOAD, KEY)
    ecu.call("canroll_secoc_start", RECORD, PAYLOAD, 7, 0)
    for k in range(24):
        frame = [(37 * k + 11 * j) & 255 for j in range(8)] + [0] * 8
        ecu._machine.mem_write(PAYLOAD, bytes(frame))
        secoc.protect(its, k % N_TX, frame)
        ecu.call("canroll_secoc_protect", RECORD, k % N_TX, PAYLOAD)
        assert 0 < ecu.instructions <= BUDGET[cpu]
        assert bytes(ecu._machine.mem_read(PAYLOAD, SECURED)) == bytes(frame)
        # half of them are another message's, which authenticates nothing
        message = k % N_RX
        expected = secoc.verify(its, message, frame, SECURED)
        assert ecu.call("canroll_secoc_verify", RECORD, message, PAYLOAD, SECURED) == expected
        assert ecu.instructions <= BUDGET[cpu]
    size = memory_image.dtype(Secoc).itemsize
    assert bytes(ecu._machine.mem_read(RECORD, size)) == memory_image.image(its)
