"""The diagnostic server beside a running ECU, as CPython or as compiled C."""

import numpy as np

from canroll.errors import CanrollError
from codegen.generated.bus_map import Uds, frame_ident
from codegen.run import memory_image, native
from codegen.run.backends import NativeEcu, PythonEcu
from codegen.run.bus_firmware import BusFirmware


def idents(firmware: BusFirmware) -> Uds:
    """Return the identifiers of UDS on a bus.

    Raises:
        CanrollError: the map has none.
    """
    uds = firmware.bus.uds
    if uds is None:
        raise CanrollError("--uds requires a table [uds] with request and response in the map")
    return uds


def numbers(firmware: BusFirmware) -> tuple[int, int]:
    """Return the identifiers of the frames to the server and from it."""
    found = idents(firmware)
    return frame_ident(found.request), frame_ident(found.response)


class PythonServer:
    """The server run by CPython beside a :class:`PythonEcu`."""

    def __init__(self, ecu: PythonEcu, firmware: BusFirmware) -> None:
        self.hears, self.answers = numbers(firmware)
        self._module = firmware.module("services.uds")
        self.record = firmware.module("services.uds_state").Uds()
        self._ecu = ecu
        self._module.init(self.record, ecu.state)

    def receive(self, payload: bytes) -> None:
        """Put a frame in the mailbox."""
        self._module.receive(self.record, list(payload.ljust(8, b"\0")), len(payload))

    def tick(self, elapsed: int) -> None:
        """Read a frame and send one, after a tick of the loop."""
        self._module.tick(self.record, self._ecu.state, self._ecu.running, elapsed)

    def take(self) -> list[bytes]:
        """The frame marked for sending, if any; clears the mark."""
        its = self.record
        found = [bytes(its.tx_payload)] if its.tx_pending else []
        its.tx_pending = 0
        return found


class NativeServer:
    """The server as compiled C beside a :class:`NativeEcu`."""

    def __init__(self, ecu: NativeEcu, firmware: BusFirmware) -> None:
        self.hears, self.answers = numbers(firmware)
        library = native.library_of(firmware)
        kind = memory_image.dtype(firmware.module("services.uds_state").Uds)
        assert library.lib.canroll_uds_size() == kind.itemsize
        self._lib, self._ecu = library.lib, ecu
        self.record = np.zeros(1, kind)
        buffer = library.ffi.from_buffer
        self._its = buffer("uint8_t[]", self.record, require_writable=True)
        self._state = buffer("uint8_t[]", ecu.ecu, require_writable=True)
        self._lib.canroll_uds_start(self._its, self._state)

    def receive(self, payload: bytes) -> None:
        """Put a frame in the mailbox."""
        self._lib.canroll_uds_put(self._its, payload.ljust(8, b"\0"), len(payload))

    def tick(self, elapsed: int) -> None:
        """Read a frame and send one, after a tick of the loop."""
        self._lib.canroll_uds_step(self._its, self._state, self._ecu.running, elapsed)

    def take(self) -> list[bytes]:
        """The frame marked for sending, if any; clears the mark."""
        its = self.record[0]
        found = [its["tx_payload"].tobytes()] if its["tx_pending"] else []
        its["tx_pending"] = 0
        return found


def server_of(ecu: PythonEcu | NativeEcu, firmware: BusFirmware) -> PythonServer | NativeServer:
    """Start the server beside an ECU."""
    if isinstance(ecu, PythonEcu):
        return PythonServer(ecu, firmware)
    return NativeServer(ecu, firmware)
