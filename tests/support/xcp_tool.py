"""A small XCP master: one command at a time, on any ECU with the slave."""

import struct
from typing import Any

import numpy as np

from canroll.codegen.run import memory_image
from canroll.codegen.run.services import ServedEcu
from canroll.extensions.services.modules import xcp
from canroll.extensions.services.running import PAGE_ADDRESS, STATE_ADDRESS
from canroll.firmware.calibration import Calibration

PATIENCE = 200


class Tool:
    """Sends commands and runs ticks until they are answered."""

    def __init__(self, ecu: ServedEcu) -> None:
        self.ecu, self.slave = ecu, ecu.services["xcp"]
        self.ticks = 0
        self.sampled: list[bytes] = []

    def ask(self, *command: int) -> bytes:
        """Send a command; return its answer, frames of measurements go to ``sampled``."""
        self.slave.receive(bytes(command))
        for _ in range(PATIENCE):
            answers = [frame for frame in self.tick() if frame[0] >= 0xFE]
            if answers:
                (answer,) = answers
                return answer
        return b""

    def tick(self) -> list[bytes]:
        """Run a tick; return the frames of the slave."""
        self.ecu.run(1)
        self.ticks += 1
        frames = self.slave.take()
        self.sampled += [frame for frame in frames if frame[0] < 0xC0]
        return frames

    def measure(
        self, *places: tuple[int, int], mode: int = 0, event: int = 0, every: int = 1
    ) -> None:
        """Start list 0 with a frame for each (address, bytes)."""
        its = [xcp.CONNECT, xcp.FREE_DAQ]
        for code in its:
            assert self.ask(code, 0)[0] == 0xFF
        asked = [(xcp.ALLOC_DAQ, 0, 1, 0), (xcp.ALLOC_ODT, 0, 0, 0, len(places))]
        asked += [(xcp.ALLOC_ODT_ENTRY, 0, 0, 0, k, 1) for k in range(len(places))]
        for k, (address, count) in enumerate(places):
            asked += [(xcp.SET_DAQ_PTR, 0, 0, 0, k, 0)]
            asked += [(xcp.WRITE_DAQ, 255, count, 0, *word(address))]
        asked += [(xcp.SET_DAQ_LIST_MODE, mode, 0, 0, event, 0, every, 0)]
        asked += [(xcp.START_STOP_DAQ_LIST, 1, 0, 0)]
        for command in asked:
            assert self.ask(*command)[0] == 0xFF, command


def word(address: int) -> bytes:
    """The four bytes of an address in a command."""
    return struct.pack("<I", address)


def address_of(name: str, record: Any, *, index: int = 0) -> int:
    """The address of a field's element by which the tool names it."""
    its = memory_image.dtype(record)
    assert its.fields is not None
    kind, offset = its.fields[name][:2]
    base = PAGE_ADDRESS if record is Calibration else STATE_ADDRESS
    return base + int(offset) + index * int(np.dtype(kind.base).itemsize)
