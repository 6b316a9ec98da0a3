"""The services of a firmware beside its running loop: the XCP slave and the diagnostic server.

The XCP tool names the records by addresses: those of the A2L of an export with ``--xcp`` until an
image is known.
"""

from collections.abc import Mapping
from typing import Any, Protocol

from canroll.errors import CanrollError
from codegen.generated.bus_map import UdsFrames, XcpFrames, frame_ident
from codegen.run.backends import NativeEcu, PythonEcu, open_backend
from codegen.run.bus_firmware import AUTHENTICATION, BusFirmware, built_in
from codegen.run.ecu import Backend, EcuBackend
from codegen.run.ecu_traffic import Frame, Payload
from codegen.run.machine import MachineRecord
from codegen.run.secured import NEW, Lasting
from dbc.keys import DEVELOPMENT_KEY
from firmware.calibration import Calibration

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


class Service(Protocol):
    """One service: the identifiers it hears and answers by, its frames in and out."""

    record: MachineRecord
    hears: int
    answers: int

    def receive(self, payload: bytes) -> None:
        """Put a frame in its mailbox."""

    def tick(self, elapsed: int) -> None:
        """Do its work after a tick of the loop."""

    def take(self) -> list[bytes]:
        """The frames marked for sending; clears the marks."""


class Slave:
    """The XCP slave beside an ECU, which it may put on its working page."""

    def __init__(self, ecu: EcuBackend) -> None:
        self.hears, self.answers = xcp_frames(ecu.firmware)
        self._ecu, self._machine = ecu, ecu.machine
        xcp_state = ecu.firmware.module("services.xcp_state")
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
        uds_state = ecu.firmware.module("services.uds_state")
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


class ServedEcu:
    """A running ECU with the services of its firmware, behind the interface of all backends."""

    def __init__(self, ecu: EcuBackend) -> None:
        self.ecu = ecu
        self.services = self._started()

    def _started(self) -> Mapping[str, Service]:
        services: dict[str, Service] = {}
        if "xcp" in self.ecu.firmware.services:
            services["xcp"] = Slave(self.ecu)
        if "uds" in self.ecu.firmware.services:
            services["uds"] = Server(self.ecu)
        return services

    def restart(self) -> None:
        """Start anew, as after a loss of power."""
        self.ecu.restart()
        self.services = self._started()

    @property
    def state(self) -> Any:  # noqa: ANN401 - the record of the bus's firmware
        """The state record, to be read only."""
        return self.ecu.state

    def image(self) -> bytes:
        """The bytes of the state record, as C lays it out."""
        return self.ecu.image()

    def receive(self, ident: int, payload: Payload, length: int) -> None:
        """Put a received frame in the mailbox of the loop or of the service that it is for."""
        for service in self.services.values():
            if ident == service.hears:
                service.receive(bytes(payload)[:length])
                return
        self.ecu.receive(ident, payload, length)

    def run(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Run one tick; return the frames of the loop, those of the services stay marked."""
        frames = self.ecu.tick(elapsed_ticks)
        for service in self.services.values():
            service.tick(elapsed_ticks)
        return frames

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Run one tick and return the frames to send, those of the loop first."""
        frames = self.run(elapsed_ticks)
        for service in self.services.values():
            frames += [(service.answers, payload) for payload in service.take()]
        return frames


def open_ecu(
    name: str,
    calibration: Calibration,
    firmware: BusFirmware | None = None,
    *,
    key: bytes = DEVELOPMENT_KEY,
    lasting: Lasting = NEW,
) -> Backend:
    """Start an ECU with ``calibration`` and the services of ``firmware`` on the backend ``name``.

    ``key`` and ``lasting`` are for a bus with authenticated frames, as in
    :func:`codegen.run.backends.open_backend`.

    Raises:
        CanrollError: as there, or the backend or the bus has no services.
    """
    firmware = firmware or built_in()
    services = [name for name in firmware.services if name != AUTHENTICATION]
    asked = " and ".join(f"--{service}" for service in services)
    if services and firmware.bus.secured:
        raise CanrollError(f"{asked}: not on a bus with authenticated frames: omit it")
    ecu = open_backend(name, calibration, firmware, key=key, lasting=lasting)
    if not services:
        return ecu
    if not isinstance(ecu, PythonEcu | NativeEcu):
        raise CanrollError(f"{asked} requires --backend native or python, not {name}")
    return ServedEcu(ecu)
