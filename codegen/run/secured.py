"""A running ECU behind the authentication of its frames, as its integrator builds it.

Received frames are verified before the loop gets them, and its frames protected before they are
sent; lasting memory counts the starts and remembers those of the senders.
"""

from dataclasses import dataclass
from typing import Any

from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.ecu import EcuBackend
from canroll.codegen.run.ecu_traffic import Frame, Payload
from canroll.codegen.run.machine import Machine, MachineRecord
from canroll.firmware.security.secoc_state import RESET_MAX, SECURED

LISTENING_US = 100_000
"""Time after a start for which no frame is taken, µs: twice the slowest cycle time in use."""


@dataclass(frozen=True, slots=True)
class Lasting:
    """What an ECU remembers without power: its starts so far, and those of each mailbox's sender.

    ``senders`` may be empty: none was heard.
    """

    starts: int = 0
    senders: tuple[int, ...] = ()


NEW = Lasting()
"""The memory of an ECU that was never started."""


class SecocModule:
    """The firmware's module ``secoc`` with its record, on a machine."""

    def __init__(self, machine: Machine, firmware: BusFirmware) -> None:
        self._machine = machine
        secoc_state = firmware.module("security.secoc_state")
        self.record: MachineRecord = self._machine.record(secoc_state.Secoc())

    def start(self, key: bytes, reset: int, listening: int) -> None:
        """Start with a key as the start number ``reset``."""
        self._machine.call("secoc.start", self.record, key, reset, listening)

    def resume(self, message: int, reset: int) -> None:
        """Continue with a sender."""
        self._machine.call("secoc.resume", self.record, message, reset)

    def elapse(self, ticks: int) -> None:
        """Count ticks."""
        self._machine.call("secoc.elapse", self.record, ticks)

    def verify(self, message: int, frame: bytes, length: int) -> bool:
        """Whether a received frame is to be taken."""
        return bool(self._machine.call("secoc.verify", self.record, message, frame, length))

    def protect(self, slot: int, frame: bytes) -> bytes:
        """Return a frame with freshness value and MAC."""
        secured = bytearray(frame)
        self._machine.call("secoc.protect", self.record, slot, secured)
        return bytes(secured)

    @property
    def refused(self) -> int:
        """Frames refused since the start."""
        return int(self.record["refused"])

    @property
    def starts(self) -> int:
        """Number of the start that its frames belong to."""
        return int(self.record["tx_reset"])

    @property
    def senders(self) -> tuple[int, ...]:
        """Number of the last known start of each message's sender."""
        return tuple(map(int, self.record["rx_reset"]))


class SecuredEcu:
    """A running ECU on a bus with authenticated frames, behind the interface of all backends.

    ``accepted`` counts the frames that it took.
    """

    def __init__(
        self, ecu: EcuBackend, *, key: bytes, tick_us: int, lasting: Lasting = NEW
    ) -> None:
        self._ecu, self._secoc, self._key = ecu, SecocModule(ecu.machine, ecu.firmware), key
        self._slot_of = {ident: slot for slot, (ident, _) in enumerate(ecu.firmware.sent)}
        self._listening = listening_ticks(tick_us)
        self.accepted = 0
        self._refused_before = 0
        self._begin(lasting)

    def _begin(self, lasting: Lasting) -> None:
        """Start as after a loss of power, with what the lasting memory holds."""
        self._secoc.start(self._key, min(lasting.starts + 1, RESET_MAX), self._listening)
        for message, reset in enumerate(lasting.senders):
            self._secoc.resume(message, reset)

    @property
    def lasting(self) -> Lasting:
        """What it remembers without power."""
        return Lasting(self._secoc.starts, tuple(self._secoc.senders))

    def restart(self) -> None:
        """Start anew, as after a loss of power."""
        self._refused_before = self.refused
        lasting = self.lasting
        self._ecu.restart()
        self._begin(lasting)

    @property
    def refused(self) -> int:
        """Frames refused by the authentication, of all starts."""
        return self._refused_before + self._secoc.refused

    @property
    def state(self) -> Any:  # noqa: ANN401 - the record of the bus's firmware
        """The state record, to be read only."""
        return self._ecu.state

    def image(self) -> bytes:
        """The bytes of the state record, as C lays it out."""
        return self._ecu.image()

    def receive(self, ident: int, payload: Payload, length: int) -> None:
        """Verify a received frame and put it in its mailbox; an unmapped identifier is ignored."""
        frame = bytes(payload)[:SECURED].ljust(SECURED, b"\0")
        for slot in self._ecu.firmware.slots.get(ident, ()):
            if self._secoc.verify(slot, frame, length):
                self.accepted += 1
                self._ecu.receive(ident, frame, length)
        if ident in self._slot_of:
            # nobody else may send it, authentic or not
            self._ecu.receive(ident, frame, length)

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Run one tick and return the frames to send, protected, in order."""
        self._secoc.elapse(elapsed_ticks)
        return [self.protected(frame) for frame in self._ecu.tick(elapsed_ticks)]

    def protected(self, frame: Frame) -> Frame:
        """Return a frame of the loop as it is sent."""
        ident, payload = frame
        return ident, self._secoc.protect(self._slot_of[ident], payload)


def listening_ticks(tick_us: int) -> int:
    """Return the ticks of :data:`LISTENING_US`."""
    return -(-LISTENING_US // tick_us)
