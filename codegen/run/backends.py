"""One interface to a running ECU for all backends: CPython, native code, Cortex-M.

All produce the same bytes on the bus and the same state, for any calibration and traffic.
"""

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, UnknownNameError
from codegen.run import BACKENDS, memory_image, native
from codegen.run.authentication import (
    Authentication,
    CortexAuthentication,
    NativeAuthentication,
    PythonAuthentication,
)
from codegen.run.bus_firmware import BusFirmware, built_in
from codegen.run.ecu_traffic import Frame, Payload, Traffic, refused
from codegen.run.secured import NEW, Lasting, SecuredEcu
from codegen.run.unicorn import CortexEcu
from dbc.keys import DEVELOPMENT_KEY
from firmware.calibration import Calibration


@runtime_checkable
class Backend(Protocol):
    """One running ECU."""

    def restart(self) -> None:
        """Start anew, as after a loss of power."""

    def receive(self, ident: int, payload: Payload, length: int) -> None:
        """Put a received frame in its mailbox; an unmapped identifier is ignored."""

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Run one tick and return the frames to send, in order."""

    @property
    def state(self) -> Any:  # noqa: ANN401 - the record of the bus's firmware
        """The state record, to be read only."""

    def image(self) -> bytes:
        """The bytes of the state record, as C lays it out."""


class PythonEcu:
    """The firmware run by CPython, line by line."""

    def __init__(self, calibration: Calibration, firmware: BusFirmware | None = None) -> None:
        self._firmware = firmware or built_in()
        self._loop: Any = self._firmware.loop
        self._calibration = calibration
        self._room = memory_image.event_of(self._firmware.record)["payload"].shape[0]
        self.restart()

    def restart(self) -> None:
        """Start anew, as after a loss of power."""
        self._ecu = self._firmware.record()
        rule = self._loop.init(self._ecu, self._calibration)
        if rule:
            raise refused(rule)

    @property
    def state(self) -> Any:  # noqa: ANN401 - the record of the bus's firmware
        """The state record, to be read only."""
        return self._ecu

    def image(self) -> bytes:
        """The bytes of the state record, as C lays it out."""
        return memory_image.image(self._ecu)

    @property
    def running(self) -> Calibration:
        """The calibration it runs on."""
        return self._calibration

    def run_on(self, calibration: Calibration) -> None:
        """Run on another calibration from the next tick on."""
        self._calibration = calibration

    def receive(self, ident: int, payload: Payload, length: int) -> None:
        """Put a received frame in its mailbox; an unmapped identifier is ignored."""
        for slot in self._firmware.messages.get(ident, ()):
            data = list(bytes(payload).ljust(self._room, b"\0"))
            self._loop.receive(self._ecu, slot, data, length)

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Run one tick and return the frames to send, in order."""
        ecu = self._ecu
        self._loop.tick(ecu, self._calibration, elapsed_ticks)
        frames = []
        for slot, pending in enumerate(ecu.tx_pending):
            if pending:
                ident, length = self._firmware.sent[slot]
                if length:
                    frames.append((ident, bytes(ecu.tx_payload[slot][:length])))
                ecu.tx_pending[slot] = 0
        return frames


class NativeEcu:
    """The firmware as compiled C; ``ecu`` and ``calibration`` are the records in memory."""

    def __init__(self, calibration: Calibration, firmware: BusFirmware | None = None) -> None:
        self._firmware = firmware or built_in()
        record = self._firmware.record
        self._library = native.library_of(self._firmware)
        kind = memory_image.dtype(Calibration)
        self.calibration = np.frombuffer(memory_image.image(calibration), kind, 1).copy()
        self.ecu = self._library.start(self.calibration)
        buffer = self._library.ffi.from_buffer
        self._ecu = buffer("uint8_t[]", self.ecu, require_writable=True)
        self._cal = buffer("uint8_t[]", self.calibration)
        places = memory_image.dtype(record).fields
        assert places is not None
        view = self.ecu.view(np.uint8).data
        first, slots = places["tx_pending"][1], len(self._firmware.sent)
        self._pending = view[first : first + slots]
        self._payloads = self.ecu["tx_payload"][0]
        self._none = bytes(slots)
        self._slots = self._firmware.messages
        self._room = memory_image.event_of(record)["payload"].shape[0]

    def restart(self) -> None:
        """Start anew, as after a loss of power."""
        self.ecu[:] = self._library.start(self.calibration)

    @property
    def firmware(self) -> BusFirmware:
        """What it runs."""
        return self._firmware

    @property
    def pointers(self) -> dict[str, int]:
        """Addresses of the C functions, of the ECU's record and of the calibration's."""
        return {
            **self._library.pointers,
            "ecu": self.ecu.ctypes.data,
            "calibration": self.calibration.ctypes.data,
        }

    @property
    def state(self) -> Any:  # noqa: ANN401 - the record of the bus's firmware
        """A copy of the state record."""
        copy = self._firmware.record()
        memory_image.fill(copy, self.image())
        return copy

    def image(self) -> bytes:
        """The bytes of the state record, as C lays it out."""
        return self.ecu.tobytes()

    @property
    def running(self) -> Any:  # noqa: ANN401 - a buffer of cffi
        """The calibration it runs on, in memory."""
        return self._cal

    def run_on(self, calibration: NDArray[np.void]) -> None:
        """Run on another calibration in memory from the next tick on."""
        self._cal = self._library.ffi.from_buffer("uint8_t[]", calibration)

    def receive(self, ident: int, payload: Payload, length: int) -> None:
        """Put a received frame in its mailbox; an unmapped identifier is ignored."""
        for slot in self._slots.get(ident, ()):
            data = bytes(payload).ljust(self._room, b"\0")
            self._library.lib.canroll_put(self._ecu, slot, data, length)

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Run one tick and return the frames to send, in order."""
        self._library.lib.canroll_step(self._ecu, self._cal, elapsed_ticks)
        if self._pending == self._none:
            return []
        frames = []
        for slot, pending in enumerate(self._pending):
            if pending:
                ident, length = self._firmware.sent[slot]
                if length:
                    frames.append((ident, self._payloads[slot, :length].tobytes()))
        self._pending[:] = self._none
        return frames


def default_backend() -> str:
    """``native`` if a C compiler is installed, else ``python``."""
    return "native" if native.compiler() else "python"


def open_backend(
    name: str,
    calibration: Calibration,
    firmware: BusFirmware | None = None,
    *,
    key: bytes = DEVELOPMENT_KEY,
    lasting: Lasting = NEW,
) -> Backend:
    """Start an ECU with ``calibration`` on the backend ``name``.

    ``firmware`` is the firmware for a bus, by default the built-in one; if the bus's frames are
    authenticated, then with ``key``, and with the memory ``lasting`` of its earlier starts.

    Raises UnknownNameError for a name not in BACKENDS, CanrollError if the ECU refuses the
    calibration or the backend's tools are missing.
    """
    if name not in BACKENDS:
        raise UnknownNameError("backend", name, BACKENDS)
    ecu: PythonEcu | NativeEcu | CortexEcu
    if name == "python":
        ecu = PythonEcu(calibration, firmware)
    elif name == "native":
        ecu = NativeEcu(calibration, firmware)
    else:
        ecu = CortexEcu(calibration, cpu=name, firmware=firmware)
    if firmware is None or not firmware.bus.secured:
        return ecu
    its = authentication_of(ecu, firmware)
    return SecuredEcu(ecu, its, firmware, key=key, tick_us=calibration.tick_us, lasting=lasting)


def authentication_of(
    ecu: PythonEcu | NativeEcu | CortexEcu, firmware: BusFirmware
) -> Authentication:
    """Return the authentication beside an ECU, run as the ECU is."""
    if isinstance(ecu, PythonEcu):
        return PythonAuthentication(firmware)
    if isinstance(ecu, NativeEcu):
        return NativeAuthentication(firmware)
    return CortexAuthentication(ecu, firmware)


class Recorder:
    """A wrapper of a backend that records its received frames and ticks as :attr:`traffic`."""

    def __init__(self, backend: Backend, firmware: BusFirmware | None = None) -> None:
        self._firmware = firmware or built_in()
        self._kind = memory_image.event_of(self._firmware.record)
        self._backend = backend
        self._rows: list[tuple[int, int, int, list[int]]] = []
        self._elapsed: list[int] = []

    @property
    def traffic(self) -> Traffic:
        """Frames and elapsed ticks of all ticks so far."""
        return Traffic(np.array(self._rows, self._kind), np.array(self._elapsed, np.int32))

    @property
    def state(self) -> Any:  # noqa: ANN401 - the record of the bus's firmware
        """The state record, to be read only."""
        return self._backend.state

    def image(self) -> bytes:
        """The bytes of the state record, as C lays it out."""
        return self._backend.image()

    def restart(self) -> None:
        """Refuse: a record of traffic says nothing of power.

        Raises:
            CanrollError: always.
        """
        raise CanrollError("a run in which the ECU loses its power cannot be recorded for replay")

    def receive(self, ident: int, payload: Payload, length: int) -> None:
        """Put a received frame in its mailbox."""
        for slot in self._firmware.messages.get(ident, ()):
            data = list(bytes(payload).ljust(self._kind["payload"].shape[0], b"\0"))
            self._rows.append((len(self._elapsed), slot, length, data))
        self._backend.receive(ident, payload, length)

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Run one tick and return the frames to send, in order."""
        self._elapsed.append(elapsed_ticks)
        return self._backend.tick(elapsed_ticks)
