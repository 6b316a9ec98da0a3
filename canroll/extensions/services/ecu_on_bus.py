"""An ECU with its services in a thread of this process, for a tool on the same bus.

It runs as many ticks as it can, each as one period: for measuring, calibrating and diagnosing by
third-party programs, not for judging time. ``canroll ecu`` is the ECU in real time.
"""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial

import can

from canroll.codegen.generated.mailbox import EXTENDED
from canroll.codegen.run import backends
from canroll.codegen.run.bus_firmware import built_in, with_services
from canroll.codegen.run.ecu_traffic import Frame
from canroll.codegen.run.services import open_ecu
from canroll.firmware.calibration import Calibration

PAUSE = 0.002
"""Longest wait for a frame before the next tick, s."""


class EcuOnBus(threading.Thread):
    """The thread: an ECU on ``calibration`` with ``services`` at a node of a bus."""

    def __init__(self, bus: can.BusABC, calibration: Calibration, services: Sequence[str]) -> None:
        super().__init__(daemon=True)
        firmware = with_services(built_in(), tuple(services))
        self.bus, self.done = bus, threading.Event()
        self.ecu = open_ecu(backends.default_backend(), calibration, firmware)
        self._loops = {ident for ident, _ in firmware.sent}

    def run(self) -> None:
        """Run ticks until ``done``; send the frames of the services, not those of the loop."""
        while not self.done.is_set():
            message = self.bus.recv(PAUSE)
            if message is not None:
                ident = message.arbitration_id | (EXTENDED if message.is_extended_id else 0)
                self.ecu.receive(ident, bytes(message.data), len(message.data))
            for frame in self.ecu.tick():
                if frame[0] not in self._loops:
                    self.bus.send(message_of(frame))


def message_of(frame: Frame) -> can.Message:
    """Return a frame as a message of python-can."""
    ident, payload = frame
    return can.Message(
        arbitration_id=ident & (EXTENDED - 1),
        is_extended_id=bool(ident & EXTENDED),
        data=payload,
    )


@contextmanager
def ecu_on_bus(
    channel: str, calibration: Calibration, services: Sequence[str], *, interface: str = "simbus"
) -> Iterator[can.BusABC]:
    """A node for a tool on a bus of python-can at 500 kbit/s, with an ECU with ``services``.

    Args:
        channel: channel of the interface.
        calibration: what the ECU runs on.
        services: of the ECU.
        interface: one in which two nodes of a process hear each other, as simbus and socketcan.

    Raises:
        can.CanError, OSError: no such bus.
    """
    bus = partial(can.Bus, channel, interface=interface, bitrate=500_000)
    with bus(queue="priority") as ours, bus() as theirs:
        thread = EcuOnBus(ours, calibration, services)
        thread.start()
        try:
            yield theirs
        finally:
            thread.done.set()
            thread.join()
