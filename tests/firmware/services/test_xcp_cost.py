"""Instructions of the XCP slave per tick on a Cortex-M4."""

import numpy as np
import pytest

from codegen.run import cortex, ecu_traffic, memory_image
from codegen.run.bus_firmware import built_in, with_services
from codegen.run.unicorn import CALIBRATION, ECU, PAYLOAD, CortexEcu
from codegen.run.xcp_slave import PAGE_ADDRESS, STATE_ADDRESS
from firmware.services import xcp
from firmware.services.xcp_state import Xcp

pytestmark = pytest.mark.skipif(
    not cortex.has_pip_tools(), reason="needs ziglang and unicorn (canroll[target])"
)
SLAVE, WORKING = 0x2001_0000, 0x2001_4000
VALUES = 20


class Machine:
    """The slave on an emulated Cortex-M4."""

    def __init__(self):
        served = with_services(built_in(), ("xcp",))
        record = ecu_traffic.random_calibration(3)
        self.ecu = CortexEcu(record, cpu="cortex-m4", count=True, firmware=served)
        self.kind = memory_image.dtype(Xcp)
        where = (SLAVE, CALIBRATION, WORKING, STATE_ADDRESS, PAGE_ADDRESS)
        self.ecu.call("canroll_xcp_init", *where)

    def put(self, *command):
        self.ecu._machine.mem_write(PAYLOAD, bytes(command).ljust(8, b"\0"))
        self.ecu.call("canroll_xcp_receive", SLAVE, PAYLOAD, len(command))

    def tick(self):
        """Instructions of a tick, and the frames that it sent."""
        self.ecu.call("canroll_xcp_tick", SLAVE, ECU, CALIBRATION, WORKING, 1)
        count = self.ecu.instructions
        data = bytes(self.ecu._machine.mem_read(SLAVE, self.kind.itemsize))
        its = np.frombuffer(data, self.kind, 1)[0]
        offset = self.kind.fields["tx_pending"][1]
        self.ecu._machine.mem_write(SLAVE + offset, bytes(len(its["tx_pending"])))
        frames = [
            its["tx_payload"][slot, : its["tx_length"][slot]].tobytes()
            for slot in np.flatnonzero(its["tx_pending"])
        ]
        return count, frames

    def ask(self, *command):
        self.put(*command)
        (answer,) = [frame for frame in self.tick()[1] if frame[0] >= 0xFE]
        assert answer[0] == 0xFF, command


def test_twenty_values_take_at_most_1500_instructions_a_tick():
    machine = Machine()
    assert machine.tick()[0] < 100
    machine.ask(xcp.CONNECT, 0)
    machine.ask(xcp.FREE_DAQ)
    machine.ask(xcp.ALLOC_DAQ, 0, 1, 0)
    machine.ask(xcp.ALLOC_ODT, 0, 0, 0, VALUES)
    for k in range(VALUES):
        machine.ask(xcp.ALLOC_ODT_ENTRY, 0, 0, 0, k, 1)
    for k in range(VALUES):
        machine.ask(xcp.SET_DAQ_PTR, 0, 0, 0, k, 0)
        machine.ask(xcp.WRITE_DAQ, 255, 4, 0, *(STATE_ADDRESS + 4 * k).to_bytes(4, "little"))
    machine.ask(xcp.SET_DAQ_LIST_MODE, 0, 0, 0, 0, 0, 1, 0)
    machine.ask(xcp.START_STOP_DAQ_LIST, 1, 0, 0)
    state = machine.ecu.image()
    for _ in range(3):
        count, frames = machine.tick()
        assert count <= 1500
        expected = [bytes([k]) + state[4 * k : 4 * k + 4] for k in range(VALUES)]
        assert frames == expected
    # and a bounded part more while a page is checked
    machine.put(xcp.SET_CAL_PAGE, 1, 0, 1)
    counts = [machine.tick()[0] for _ in range(90)]
    assert max(counts) <= 1500 + 1000
