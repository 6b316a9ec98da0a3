"""The XCP slave and the diagnostic server beside an ECU's running loop.

The XCP tool names the records by addresses: those of the A2L of an export with ``--xcp`` until an
image is known.
"""

from canroll.codegen.generated.bus_map import UdsFrames, XcpFrames, frame_ident
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.ecu import EcuBackend
from canroll.codegen.run.machine import MachineRecord
from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration

STATE_ADDRESS = 0x2000_0000
PAGE_ADDRESS = 0x0800_0000


def xcp_idents(firmware: BusFirmware) -> XcpFrames:
    """Return the identifiers of XCP on a bus.

    Raises:
        CanrollError: the map has none.
    """
    xcp = firmware.bus.xcp
    if xcp is None:
        raise CanrollError("--xcp requires a table [xcp] with master, slave and bitrate in the map")
    return xcp


def uds_idents(firmware: BusFirmware) -> UdsFrames:
    """Return the identifiers of UDS on a bus.

    Raises:
        CanrollError: the map has none.
    """
    uds = firmware.bus.uds
    if uds is None:
        raise CanrollError("--uds requires a table [uds] with request and response in the map")
    return uds


def xcp_frames(firmware: BusFirmware) -> tuple[int, int]:
    """Return the identifiers of the frames to the slave and from it."""
    xcp = xcp_idents(firmware)
    return frame_ident(xcp.master), frame_ident(xcp.slave)


def uds_frames(firmware: BusFirmware) -> tuple[int, int]:
    """Return the identifiers of the frames to the server and from it."""
    uds = uds_idents(firmware)
    return frame_ident(uds.request), frame_ident(uds.response)


class Slave:
    """The XCP slave beside an ECU, which it may put on its working page."""

    def __init__(self, ecu: EcuBackend) -> None:
        self.hears, self.answers = xcp_frames(ecu.firmware)
        self._ecu, self._machine = ecu, ecu.machine
        xcp_state = ecu.firmware.module("xcp_state")
        self.record: MachineRecord = self._machine.record(xcp_state.Xcp())
        self.working: MachineRecord = self._machine.record(Calibration())
        pages = ecu.calibration, self.working
        self._machine.call("xcp.init", self.record, *pages, STATE_ADDRESS, PAGE_ADDRESS)

    def receive(self, payload: bytes) -> None:
        """Put a command in the mailbox."""
        self._machine.call("xcp.receive", self.record, payload.ljust(8, b"\0"), len(payload))

    def tick(self, elapsed: int) -> None:
        """Answer a command and sample, after a tick of the loop."""
        ecu = self._ecu
        records = self.record, ecu.record, ecu.calibration, self.working
        self._machine.call("xcp.tick", *records, elapsed)
        ecu.running = self.working if self.record["ecu_page"] else ecu.calibration

    def take(self) -> list[bytes]:
        """The frames marked for sending; clears the marks."""
        marks, lengths = self.record["tx_pending"], self.record["tx_length"]
        payloads = self.record["tx_payload"]
        sent = [slot for slot, mark in enumerate(marks) if mark]
        frames = [bytes(payloads[slot][: lengths[slot]]) for slot in sent]
        self.record["tx_pending"] = [0] * len(marks)
        return frames


class Server:
    """The diagnostic server beside an ECU."""

    def __init__(self, ecu: EcuBackend) -> None:
        self.hears, self.answers = uds_frames(ecu.firmware)
        self._ecu, self._machine = ecu, ecu.machine
        uds_state = ecu.firmware.module("uds_state")
        self.record: MachineRecord = self._machine.record(uds_state.Uds())
        self._machine.call("uds.init", self.record, ecu.record)

    def receive(self, payload: bytes) -> None:
        """Put a frame in the mailbox."""
        self._machine.call("uds.receive", self.record, payload.ljust(8, b"\0"), len(payload))

    def tick(self, elapsed: int) -> None:
        """Read a frame and send one, after a tick of the loop."""
        ecu = self._ecu
        self._machine.call("uds.tick", self.record, ecu.record, ecu.running, elapsed)

    def take(self) -> list[bytes]:
        """The frame marked for sending, if any; clears the mark."""
        frames = [bytes(self.record["tx_payload"])] if self.record["tx_pending"] else []
        self.record["tx_pending"] = 0
        return frames
