"""One interface to a running ECU for all backends: CPython, native code, Cortex-M.

All produce the same bytes on the bus and the same state, for any calibration and traffic.
"""

from typing import Any

import numpy as np

from canroll.codegen.run import BACKENDS, memory_image, native
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.codegen.run.ecu import Backend, EcuBackend
from canroll.codegen.run.ecu_traffic import EcuTraffic, Frame, Payload
from canroll.codegen.run.machine import PythonMachine
from canroll.codegen.run.secured import NEW, Lasting, SecuredEcu
from canroll.dbc.keys import DEVELOPMENT_KEY
from canroll.errors import CanrollError, UnknownNameError
from canroll.firmware.calibration import Calibration

__all__ = ["Backend", "NativeEcu", "PythonEcu", "Recorder", "default_backend", "open_backend"]


class PythonEcu(EcuBackend):
    """An ECU whose firmware is run by CPython, line by line."""

    def __init__(self, calibration: Calibration, firmware: BusFirmware | None = None) -> None:
        firmware = firmware or built_in()
        super().__init__(PythonMachine(firmware), calibration, firmware)


class NativeEcu(EcuBackend):
    """An ECU whose firmware is compiled C, its records in the memory of this process."""

    machine: native.NativeMachine
    record: native.NativeRecord
    calibration: native.NativeRecord

    def __init__(self, calibration: Calibration, firmware: BusFirmware | None = None) -> None:
        firmware = firmware or built_in()
        super().__init__(native.NativeMachine(firmware), calibration, firmware)

    @property
    def pointers(self) -> dict[str, int]:
        """Addresses of the C functions, of the ECU's record and of the calibration's."""
        return {
            **self.machine.library.pointers,
            "ecu": self.record.array.ctypes.data,
            "calibration": self.calibration.array.ctypes.data,
        }


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
    ecu: EcuBackend
    if name == "python":
        ecu = PythonEcu(calibration, firmware)
    elif name == "native":
        ecu = NativeEcu(calibration, firmware)
    else:
        # the builds for a processor, its emulator and the reader of its images
        from canroll.codegen.run.unicorn import CortexEcu  # noqa: PLC0415

        ecu = CortexEcu(calibration, cpu=name, firmware=firmware)
    if not ecu.firmware.bus.secured:
        return ecu
    return SecuredEcu(ecu, key=key, tick_us=calibration.tick_us, lasting=lasting)


class Recorder:
    """A wrapper of a backend that records its received frames and ticks as :attr:`traffic`."""

    def __init__(self, backend: Backend, firmware: BusFirmware | None = None) -> None:
        self._firmware = firmware or built_in()
        self._kind = memory_image.event_of(self._firmware.record)
        self._backend = backend
        self._rows: list[tuple[int, int, int, list[int]]] = []
        self._elapsed: list[int] = []

    @property
    def traffic(self) -> EcuTraffic:
        """Frames and elapsed ticks of all ticks so far."""
        return EcuTraffic(np.array(self._rows, self._kind), np.array(self._elapsed, np.int32))

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
