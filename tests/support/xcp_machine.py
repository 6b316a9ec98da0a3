"""The XCP slave on an emulated Cortex-M4, its instructions counted."""

import numpy as np

from codegen.run import ecu_traffic, memory_image
from codegen.run.bus_firmware import built_in, with_services
from codegen.run.unicorn import CALIBRATION, ECU, PAYLOAD, CortexEcu
from codegen.run.xcp_slave import PAGE_ADDRESS, STATE_ADDRESS
from firmware.services import xcp
from firmware.services.xcp_state import Xcp

SLAVE, WORKING = 0x2001_0000, 0x2001_4000
VALUES = 20


class Machine:
    """The slave on an emulated Cortex-M4."""

    def __init__(self) -> None:
        served = with_services(built_in(), ("xcp",))
        record = ecu_traffic.random_calibration(3)
        self.ecu = CortexEcu(record, cpu="cortex-m4", count=True, firmware=served)
        self.kind = memory_image.dtype(Xcp)
        where = (SLAVE, CALIBRATION, WORKING, STATE_ADDRESS, PAGE_ADDRESS)
        self.ecu.call("canroll_xcp_init", *where)

    def put(self, *command: int) -> None:
        self.ecu._machine.mem_write(PAYLOAD, bytes(command).ljust(8, b"\0"))
        self.ecu.call("canroll_xcp_receive", SLAVE, PAYLOAD, len(command))

    def tick(self) -> tuple[int, list[bytes]]:
        """Instructions of a tick, and the frames that it sent."""
        self.ecu.call("canroll_xcp_tick", SLAVE, ECU, CALIBRATION, WORKING, 1)
        count = self.ecu.instructions
        data = bytes(self.ecu._machine.mem_read(SLAVE, self.kind.itemsize))
        its = np.frombuffer(data, self.kind, 1)[0]
        places = self.kind.fields
        assert places is not None
        offset = places["tx_pending"][1]
        self.ecu._machine.mem_write(SLAVE + offset, bytes(len(its["tx_pending"])))
        frames = [
            its["tx_payload"][slot, : its["tx_length"][slot]].tobytes()
            for slot in np.flatnonzero(its["tx_pending"])
        ]
        return count, frames

    def ask(self, *command: int) -> None:
        self.put(*command)
        (answer,) = [frame for frame in self.tick()[1] if frame[0] >= 0xFE]
        assert answer[0] == 0xFF, command

    def measure(self) -> None:
        """Connect and start a list of VALUES fields of the state, every tick."""
        self.ask(xcp.CONNECT, 0)
        self.ask(xcp.FREE_DAQ)
        self.ask(xcp.ALLOC_DAQ, 0, 1, 0)
        self.ask(xcp.ALLOC_ODT, 0, 0, 0, VALUES)
        for k in range(VALUES):
            self.ask(xcp.ALLOC_ODT_ENTRY, 0, 0, 0, k, 1)
        for k in range(VALUES):
            self.ask(xcp.SET_DAQ_PTR, 0, 0, 0, k, 0)
            self.ask(xcp.WRITE_DAQ, 255, 4, 0, *(STATE_ADDRESS + 4 * k).to_bytes(4, "little"))
        self.ask(xcp.SET_DAQ_LIST_MODE, 0, 0, 0, 0, 0, 1, 0)
        self.ask(xcp.START_STOP_DAQ_LIST, 1, 0, 0)
