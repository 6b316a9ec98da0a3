"""A backend that keeps what it was given, so that a run can be replayed elsewhere."""

import numpy as np

from codegen.run.backends import SLOT, Backend, Frame, Payload
from codegen.run.ecu_traffic import EVENT, Traffic
from firmware.state import Ecu


class Recorder:
    """Stands between a run and its ECU; :attr:`traffic` is what came through so far."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._rows: list[tuple[int, int, int, list[int]]] = []
        self._elapsed: list[int] = []

    @property
    def traffic(self) -> Traffic:
        """Frames and elapsed ticks of all ticks so far."""
        return Traffic(np.array(self._rows, EVENT), np.array(self._elapsed, np.int32))

    @property
    def state(self) -> Ecu:
        """The state record, to be read only."""
        return self._backend.state

    def image(self) -> bytes:
        """The bytes of the state record, as C lays it out."""
        return self._backend.image()

    def receive(self, ident: int, payload: Payload, length: int) -> None:
        """Put a received frame in its mailbox."""
        if ident in SLOT:
            data = list(bytes(payload).ljust(8, b"\0"))
            self._rows.append((len(self._elapsed), SLOT[ident], length, data))
        self._backend.receive(ident, payload, length)

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Run one tick and return the frames to send, in order."""
        self._elapsed.append(elapsed_ticks)
        return self._backend.tick(elapsed_ticks)
