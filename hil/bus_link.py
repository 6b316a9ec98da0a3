"""A python-can bus for the loops: all waiting frames are read at once, sends are counted.

No thread reads the bus, as a notifier's thread would compete with the loop for the interpreter; the
loop calls :meth:`Link.receive` once a period.
"""

import argparse
import logging
import select
import socket
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Protocol

import can

from canroll.codegen.generated.mailbox import EXTENDED
from canroll.errors import CanrollError
from canroll.hil.hardware import interfaces
from canroll.hil.hardware.bus_options import open_bus, options_of
from canroll.hil.hardware.bus_record import BusRecord, source

__all__ = [
    "EXTENDED",
    "NOTES",
    "CanLink",
    "Frame",
    "Link",
    "open_link",
]

Frame = tuple[int, bytes]
NOTES = frozenset((EXTENDED | 0x1CA00000, EXTENDED | 0x1CA00001))
"""Identifiers of lock step's grants and acknowledgements, which are no frames of the run."""
RETRY = 0.5
"""Time between two attempts to reach a server that went away, s."""


class Link(Protocol):
    """Interface to send and receive frames on any carrier.

    An identifier of 29 bits carries :data:`EXTENDED`. ``sent`` and ``received`` count data frames,
    the notes of lock step left out.
    """

    sent: int
    received: int

    @property
    def record(self) -> BusRecord | None:
        """Record of a real bus, or None."""

    @property
    def failed(self) -> int:
        """Frames that could not be sent."""

    def receive(self) -> list[Frame]:
        """Return the waiting frames (identifier, payload) but notes, without blocking."""

    def next(self, timeout: float) -> Frame | None:
        """Return the next data frame, None where none comes within ``timeout`` seconds."""

    def send(self, ident: int, payload: bytes) -> None:
        """Send a frame; count it as failed if the bus does not accept it."""

    def close(self) -> None:
        """Close the connection."""


class CanLink:
    """A link over a python-can bus; a lost connection to a server is reopened when possible.

    Attributes:
        lost: the connection to the server is lost.
        record: all traffic on the bus, None if it is not kept.

    Args:
        bus: open bus.
        reopen: function that reopens it; raises CanrollError while that fails. None: it never is.
        record: filled with all traffic on the bus.
        echoes: the interface echoes sent frames, which are dropped.
        unmarked: it gives them back like those of others; as many as were sent are dropped.
        fd: identifiers of the CAN FD frames, and whether they are sent with bit-rate switch; a
            frame of the other format is not received. None: frames of either are.
    """

    def __init__(
        self,
        bus: can.BusABC,
        reopen: Callable[[], can.BusABC] | None = None,
        *,
        record: BusRecord | None = None,
        echoes: bool = False,
        unmarked: bool = False,
        fd: Mapping[int, bool] | None = None,
    ) -> None:
        self.bus = bus
        self._fd = fd
        self.record = record
        self._echoes = echoes
        self._given_back: Counter[tuple[int, bytes]] | None = Counter() if unmarked else None
        self.sent = self.received = self._failed = 0
        self.lost = False
        self._reopen = reopen
        self._retry_at = float("inf")
        self._stream = _stream_of(bus)

    @property
    def failed(self) -> int:
        """Frames that the bus did not accept."""
        return self._failed

    def receive(self) -> list[Frame]:
        """Return the waiting data frames; none if the interface is down."""
        frames = [frame for _, frame in self._waiting()]
        return [frame for frame in frames if frame is not None and frame[0] not in NOTES]

    def next(self, timeout: float) -> Frame | None:
        """Return the next data frame, or None after ``timeout`` seconds."""
        until = time.monotonic() + timeout
        while (message := self._recv(max(0.0, until - time.monotonic()))) is not None:
            if message[1] is not None:
                return message[1]
        return None

    def _taken(self, message: can.Message) -> Frame | None:
        """Return the data frame in a message, or None for one of another format."""
        frame = data_frame(message)
        if frame is None or self._fd is None or message.is_fd == (frame[0] in self._fd):
            return frame
        return None

    def messages(self) -> list[can.Message]:
        """Return all waiting messages of any kind, with the interface's time stamps."""
        return [message for message, _ in self._waiting()]

    def _waiting(self) -> list[tuple[can.Message, Frame | None]]:
        waiting = []
        while (message := self._recv(0.0)) is not None:
            waiting.append(message)
        return waiting

    def _recv(self, timeout: float) -> tuple[can.Message, Frame | None] | None:
        """Return the next message and its data frame, if it has one; count that."""
        if time.monotonic() > self._retry_at:
            self._try_again()
        message, down = None, False
        try:
            message = self._read(timeout)
        except (can.CanError, OSError):
            down = True
        if message is None:
            if not self.lost and _ended(self._stream):
                self._lose()
            if down or self.lost:
                # a bus that is gone does not wait: a loop that waits for it would spin
                time.sleep(min(timeout, RETRY))
            return None
        if self.record is not None:
            self.record.heard(message)
        frame = self._taken(message)
        self.received += frame is not None and frame[0] not in NOTES
        return message, frame

    def _read(self, timeout: float) -> can.Message | None:
        """Read the next message, or None after ``timeout`` seconds.

        A serial adapter is polled first: python-can always waits 1 ms for it, and returns None for
        the acknowledgement of a sent frame even if other frames are waiting.
        """
        serial = getattr(self.bus, "serialPortOrig", None)
        if serial is not None and timeout == 0 and not serial.in_waiting:
            return None
        until = time.monotonic() + timeout
        while True:
            message = self.bus.recv(max(0.0, until - time.monotonic()))
            if message is None:
                if serial is None or not serial.in_waiting:
                    return None
            elif not self._is_own(message):
                return message

    def _is_own(self, message: can.Message) -> bool:
        """Return whether the interface gives back what was sent."""
        if self._given_back is None:
            return self._echoes and not message.is_rx
        frame = message.arbitration_id, bytes(message.data)
        if self._given_back[frame] == 0:
            return False
        self._given_back[frame] -= 1
        return True

    def send(self, ident: int, payload: bytes) -> None:
        """Send a frame."""
        extended = bool(ident & EXTENDED)
        fd = self._fd or {}
        message = can.Message(
            arbitration_id=ident & ~EXTENDED,
            data=payload,
            is_extended_id=extended,
            is_fd=ident in fd,
            bitrate_switch=fd.get(ident, False),
        )
        try:
            self.bus.send(message)
        except ConnectionError:
            self._failed += 1
            self._lose()
        except (can.CanError, OSError):
            self._failed += 1
        else:
            self.sent += ident not in NOTES
            if self._given_back is not None:
                self._given_back[message.arbitration_id, payload] += 1
            if self.record is not None:
                self.record.sent(message.arbitration_id, payload, extended=extended)

    def _lose(self) -> None:
        self.lost = True
        self._retry_at = min(self._retry_at, time.monotonic() + RETRY)

    def _try_again(self) -> None:
        self._retry_at = float("inf")
        if self._reopen is None:
            return
        try:
            bus = self._reopen()
        except CanrollError:
            self._retry_at = time.monotonic() + RETRY
        else:
            self.bus.shutdown()
            self.bus = bus
            self.lost = False
            self._stream = _stream_of(bus)

    def close(self) -> None:
        """Shut the bus down."""
        self.bus.shutdown()


def data_frame(message: can.Message) -> Frame | None:
    """Return a message as a frame, or None for an error frame or a remote request."""
    if message.is_error_frame or message.is_remote_frame:
        return None
    extended = EXTENDED if message.is_extended_id else 0
    return message.arbitration_id | extended, bytes(message.data)


def _stream_of(bus: can.BusABC) -> socket.socket | None:
    """Return the TCP connection of a bus, or None for another kind of bus."""
    ends = (value for value in vars(bus).values() if isinstance(value, socket.socket))
    return next((end for end in ends if end.type == socket.SOCK_STREAM), None)


def _ended(stream: socket.socket | None) -> bool:
    """Return whether the far end has closed the connection, which python-can reads as silence."""
    if stream is None:
        return False
    try:
        readable, _, _ = select.select([stream], [], [], 0)
        return bool(readable) and not stream.recv(1, socket.MSG_PEEK)
    except (OSError, ValueError):
        return True


def open_link(args: argparse.Namespace, fd: Mapping[int, bool] | None = None) -> CanLink:
    """Open the bus described by python-can's options; ``fd`` as in :class:`CanLink`.

    Raises:
        CanrollError: it cannot be opened; the message names the command that fixes it.
    """
    logging.getLogger("can").setLevel(logging.CRITICAL)
    name, channel, bitrate, kwargs = options_of(args)
    if fd and name == "socketcand":
        raise CanrollError(
            "socketcand has no CAN FD frames: select an interface that has them, such as "
            "-i socketcan -c vcan0 --fd"
        )
    clock = interfaces.clock_of(name, kwargs)
    return CanLink(
        open_bus(args),
        lambda: open_bus(args),
        record=BusRecord(source(name, channel, clock, bitrate)),
        echoes=interfaces.echoes(name),
        unmarked=name == "udp_multicast",
        fd=fd,
    )
