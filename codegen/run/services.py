"""A running ECU with the services of its firmware."""

from collections.abc import Mapping
from pkgutil import resolve_name
from typing import Any, Protocol

from canroll.codegen.run.backends import NativeEcu, PythonEcu, open_backend
from canroll.codegen.run.bus_firmware import AUTHENTICATION, BusFirmware, built_in
from canroll.codegen.run.ecu import Backend, EcuBackend
from canroll.codegen.run.ecu_traffic import Frame, Payload
from canroll.codegen.run.machine import MachineRecord
from canroll.codegen.run.secured import NEW, Lasting
from canroll.codegen.run.service import SERVICES
from canroll.dbc.keys import DEVELOPMENT_KEY
from canroll.errors import CanrollError
from canroll.firmware.calibration import Calibration


class Served(Protocol):
    """A running service: the identifiers it hears and answers by, its frames in and out."""

    record: MachineRecord
    hears: int
    answers: int

    def receive(self, payload: bytes) -> None:
        """Put a frame in its mailbox."""

    def tick(self, elapsed: int) -> None:
        """Do its work after a tick of the loop."""

    def take(self) -> list[bytes]:
        """The frames marked for sending; clears the marks."""


class ServedEcu:
    """A running ECU with the services of its firmware, behind the interface of all backends."""

    def __init__(self, ecu: EcuBackend) -> None:
        self.ecu = ecu
        self.services = self._started()

    def _started(self) -> Mapping[str, Served]:
        starts = {name: SERVICES[name].start for name in self.ecu.firmware.services}
        return {name: resolve_name(start)(self.ecu) for name, start in starts.items() if start}

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
    :func:`canroll.codegen.run.backends.open_backend`.

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
