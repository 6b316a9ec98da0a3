"""The XCP slave beside a running ECU, as CPython or as compiled C.

The tool names the records by addresses: those of the A2L of an export with ``--xcp`` until an image
is known.
"""

import numpy as np

from canroll.errors import CanrollError
from codegen.generated.bus_map import Xcp, frame_ident
from codegen.run import memory_image, native
from codegen.run.backends import NativeEcu, PythonEcu
from codegen.run.bus_firmware import BusFirmware
from firmware.calibration import Calibration

STATE_ADDRESS = 0x2000_0000
PAGE_ADDRESS = 0x0800_0000


def idents(firmware: BusFirmware) -> Xcp:
    """Return the identifiers of XCP on a bus.

    Raises:
        CanrollError: the map has none.
    """
    xcp = firmware.bus.xcp
    if xcp is None:
        raise CanrollError("--xcp requires a table [xcp] with master, slave and bitrate in the map")
    return xcp


def numbers(firmware: BusFirmware) -> tuple[int, int]:
    """Return the identifiers of the frames to the slave and from it."""
    found = idents(firmware)
    return frame_ident(found.master), frame_ident(found.slave)


class PythonSlave:
    """The slave run by CPython beside a :class:`PythonEcu`."""

    def __init__(self, ecu: PythonEcu, reference: Calibration, firmware: BusFirmware) -> None:
        self.hears, self.answers = numbers(firmware)
        self._module = firmware.module("services.xcp")
        self.record = firmware.module("services.xcp_state").Xcp()
        self._ecu, self._reference, self.working = ecu, reference, Calibration()
        self._module.init(self.record, reference, self.working, STATE_ADDRESS, PAGE_ADDRESS)

    def receive(self, payload: bytes) -> None:
        """Put a command in the mailbox."""
        self._module.receive(self.record, list(payload.ljust(8, b"\0")), len(payload))

    def tick(self, elapsed: int) -> None:
        """Answer a command and sample, after a tick of the loop."""
        page = self.record.ecu_page
        self._module.tick(self.record, self._ecu.state, self._reference, self.working, elapsed)
        if self.record.ecu_page != page:
            self._ecu.run_on(self.working if self.record.ecu_page else self._reference)

    def take(self) -> list[bytes]:
        """The frames marked for sending; clears the marks."""
        its = self.record
        found = [
            bytes(its.tx_payload[slot][: its.tx_length[slot]])
            for slot, pending in enumerate(its.tx_pending)
            if pending
        ]
        its.tx_pending = [0] * len(its.tx_pending)
        return found


class NativeSlave:
    """The slave as compiled C beside a :class:`NativeEcu`."""

    def __init__(self, ecu: NativeEcu, reference: Calibration, firmware: BusFirmware) -> None:
        self.hears, self.answers = numbers(firmware)
        library = native.library_of(firmware)
        kind = memory_image.dtype(firmware.module("services.xcp_state").Xcp)
        assert library.lib.canroll_xcp_size() == kind.itemsize
        page = memory_image.dtype(Calibration)
        self._lib = library.lib
        self._ecu = ecu
        self._reference = np.frombuffer(memory_image.image(reference), page, 1).copy()
        self.record, self.working = np.zeros(1, kind), np.zeros(1, page)
        buffer = library.ffi.from_buffer
        self._its = buffer("uint8_t[]", self.record, require_writable=True)
        self._state = buffer("uint8_t[]", ecu.ecu, require_writable=True)
        self._cal = buffer("uint8_t[]", self._reference)
        self._page = buffer("uint8_t[]", self.working, require_writable=True)
        self._lib.canroll_xcp_start(self._its, self._cal, self._page, STATE_ADDRESS, PAGE_ADDRESS)

    def receive(self, payload: bytes) -> None:
        """Put a command in the mailbox."""
        self._lib.canroll_xcp_put(self._its, payload.ljust(8, b"\0"), len(payload))

    def tick(self, elapsed: int) -> None:
        """Answer a command and sample, after a tick of the loop."""
        page = int(self.record["ecu_page"][0])
        self._lib.canroll_xcp_step(self._its, self._state, self._cal, self._page, elapsed)
        if self.record["ecu_page"][0] != page:
            self._ecu.run_on(self._reference if page else self.working)

    def take(self) -> list[bytes]:
        """The frames marked for sending; clears the marks."""
        its = self.record[0]
        found = [
            its["tx_payload"][slot, : its["tx_length"][slot]].tobytes()
            for slot in np.flatnonzero(its["tx_pending"])
        ]
        its["tx_pending"] = 0
        return found


def slave_of(
    ecu: PythonEcu | NativeEcu, reference: Calibration, firmware: BusFirmware
) -> PythonSlave | NativeSlave:
    """Start the slave beside an ECU."""
    kind = PythonSlave if isinstance(ecu, PythonEcu) else NativeSlave
    return kind(ecu, reference, firmware)  # type: ignore[arg-type]
