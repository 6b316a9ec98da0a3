"""The XCP slave on an emulated Cortex-M4, its instructions counted."""

from canroll.codegen.run import ecu_traffic
from canroll.codegen.run.bus_firmware import built_in, with_services
from canroll.codegen.run.unicorn import CortexEcu
from canroll.extensions.services.modules import xcp
from canroll.extensions.services.running import STATE_ADDRESS, Slave

VALUES = 20


class Machine:
    """The slave on an emulated Cortex-M4."""

    def __init__(self) -> None:
        served = with_services(built_in(), ("xcp",))
        record = ecu_traffic.random_calibration(3)
        self.ecu = CortexEcu(record, cpu="cortex-m4", count=True, firmware=served)
        self.slave = Slave(self.ecu)

    def tick(self) -> tuple[int, list[bytes]]:
        """Instructions of a tick, and the frames that it sent."""
        self.slave.tick(1)
        return self.ecu.machine.instructions, self.slave.take()

    def ask(self, *command: int) -> None:
        self.slave.receive(bytes(command))
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
