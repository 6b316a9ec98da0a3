"""A tester: can-isotp and udsoncan on the ECU, tick by tick, without threads."""

from typing import Any

import isotp
from udsoncan.connections import BaseConnection

from canroll.codegen.run.services import ServedEcu

PATIENCE = 2000
ADDRESS = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=0x7A0, rxid=0x7A8)
QUICK = {"stmin": 0, "blocksize": 0, "tx_padding": 0xCC}


class UdsTester:
    """The transport of can-isotp, whose frames are exchanged with the ECU in each tick."""

    def __init__(self, ecu: ServedEcu, **parameters: Any) -> None:
        self.ecu, self.server = ecu, ecu.services["uds"]
        self.waiting: list[isotp.CanMessage] = []
        self.to_ecu: list[bytes] = []
        self.errors: list[Exception] = []
        self.frames = 0
        self.layer = isotp.TransportLayerLogic(
            rxfn=lambda timeout: self.waiting.pop(0) if self.waiting else None,
            txfn=lambda message: self.to_ecu.append(bytes(message.data)),
            address=ADDRESS,
            params=QUICK | {"override_receiver_stmin": 0} | parameters,
            error_handler=self.errors.append,
        )

    def tick(self) -> None:
        """Exchange frames: at most one to the ECU, which runs a tick."""
        self.layer.process()
        if self.to_ecu:
            self.server.receive(self.to_ecu.pop(0))
        self.ecu.run()
        for payload in self.server.take():
            self.frames += 1
            self.waiting.append(isotp.CanMessage(arbitration_id=0x7A8, data=payload))
        self.layer.process()

    def ask(self, request: bytes) -> bytes | None:
        """Send a request; return the response, or None where there is none."""
        self.layer.send(request)
        for _ in range(PATIENCE):
            self.tick()
            if self.layer.available():
                return bytes(self.layer.recv() or b"")
        return None


class TickConnection(BaseConnection):
    """A connection of udsoncan that runs the ECU while it waits."""

    def __init__(self, tester: UdsTester) -> None:
        super().__init__(name="ticks")
        self.tester = tester
        self.opened = False

    def open(self) -> "TickConnection":
        """Open."""
        self.opened = True
        return self

    def close(self) -> None:
        """Close."""
        self.opened = False

    def is_open(self) -> bool:
        """Return whether it is open."""
        return self.opened

    def empty_rxqueue(self) -> None:
        """Forget what was received."""

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        """Send a request."""
        self.tester.layer.send(payload)

    def specific_wait_frame(self, timeout: float | None = None) -> bytes | None:
        """Run the ECU until it responds."""
        for _ in range(PATIENCE):
            self.tester.tick()
            if self.tester.layer.available():
                return bytes(self.tester.layer.recv() or b"")
        return None
