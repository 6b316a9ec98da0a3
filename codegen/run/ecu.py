"""One running ECU on any machine, behind the interface of all backends."""

from typing import Any, Protocol, runtime_checkable

from canroll.codegen.run import memory_image
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.ecu_traffic import Frame, Payload, refused
from canroll.codegen.run.machine import Machine, MachineRecord
from canroll.firmware.calibration import Calibration


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


class EcuBackend:
    """The loop of a firmware on a machine.

    Attributes:
        machine: what runs it.
        firmware: what it runs.
        record: its state record.
        calibration: the calibration it starts with.
        running: the calibration it runs on, which may be set to another.
    """

    def __init__(self, machine: Machine, calibration: Calibration, firmware: BusFirmware) -> None:
        self.machine, self.firmware = machine, firmware
        self.record: MachineRecord = machine.record(firmware.record())
        self.calibration: MachineRecord = machine.record(calibration)
        self.running = self.calibration
        self._room = memory_image.event_of(firmware.record)["payload"].shape[0]
        self.restart()

    def restart(self) -> None:
        """Start anew, as after a loss of power."""
        self.record.fill(bytes(memory_image.dtype(self.firmware.record).itemsize))
        self.running = self.calibration
        rule = self.machine.call("init", self.record, self.calibration)
        if rule:
            raise refused(rule)

    @property
    def state(self) -> Any:  # noqa: ANN401 - the record of the bus's firmware
        """The state record, to be read only."""
        return self.record.value

    def image(self) -> bytes:
        """The bytes of the state record, as C lays it out."""
        return self.record.image()

    def receive(self, ident: int, payload: Payload, length: int) -> None:
        """Put a received frame in its mailbox; an unmapped identifier is ignored."""
        for message in self.firmware.messages.get(ident, ()):
            self.put(message, bytes(payload).ljust(self._room, b"\0"), length)

    def put(self, message: int, payload: bytes, length: int) -> None:
        """Store a frame in the mailbox of ``message``."""
        self.machine.call("receive", self.record, message, payload, length)

    def advance(self, elapsed_ticks: int = 1) -> None:
        """Run one tick; the frames to send stay marked in the record."""
        self.machine.call("tick", self.record, self.running, elapsed_ticks)

    def send(self) -> list[Frame]:
        """Return the frames marked for sending, and clear the marks as the bus driver does."""
        marks = bytes(self.record["tx_pending"])
        if not any(marks):
            return []
        payloads, frames = self.record["tx_payload"], []
        for slot, mark in enumerate(marks):
            ident, length = self.firmware.sent[slot] if mark else (0, 0)
            if length:
                frames.append((ident, bytes(payloads[slot][:length])))
        self.record["tx_pending"] = [0] * len(marks)
        return frames

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Run one tick and return the frames to send, in order."""
        self.advance(elapsed_ticks)
        return self.send()
