"""Grants of lock step on a separate TCP connection, for a bus that must not carry them."""

import selectors
import socket
import time
from collections.abc import Callable
from contextlib import suppress

from canroll.errors import CanrollError, VerdictError, reason
from hil.realtime.bus_link import Frame, Link
from hil.realtime.lockstep import Note

SIZE = len(Note(0, 0).payload())
CONNECT = 60.0
"""Time that an ECU waits for the plant to listen, s."""


class SideChannel:
    """A connection that carries notes of eight bytes in both directions.

    Args:
        link: the bus beside it.
        listener: listening socket of the plant, which uses the ECU that connected last.
        connection: connection of the ECU.
    """

    def __init__(
        self,
        link: Link,
        *,
        listener: socket.socket | None = None,
        connection: socket.socket | None = None,
    ) -> None:
        self._link, self._listener, self._connection = link, listener, connection
        self._received = b""
        self._selector = selectors.DefaultSelector()
        for end in (listener, connection):
            if end is not None:
                self._selector.register(end, selectors.EVENT_READ)

    @property
    def address(self) -> str:
        """The plant's listening address, HOST:PORT."""
        assert self._listener is not None
        host, port = self._listener.getsockname()[:2]
        return f"{host}:{port}"

    def send(self, note: Note) -> None:
        """Send a note to the other side; it is lost if there is none."""
        if self._connection is not None:
            with suppress(OSError):
                self._connection.sendall(note.payload())

    def wait(self, timeout: float, take: Callable[[Frame], None]) -> Note | None:
        """Return the other side's next note, or None after ``timeout`` s.

        Frames stay on the bus: ``take`` is not called.

        Raises:
            VerdictError: the plant closed the connection.
        """
        until = time.monotonic() + timeout
        while len(self._received) < SIZE:
            ready = self._selector.select(max(0.0, until - time.monotonic()))
            for key, _ in ready:
                if key.fileobj is self._listener:
                    self._accept()
                else:
                    self._read()
            if not ready:
                return None
        note, self._received = self._received[:SIZE], self._received[SIZE:]
        return Note.of(note)

    def clear(self) -> None:
        """Discard frames on the bus that were sent before the last grant."""
        self._link.receive()

    def close(self) -> None:
        """Close the connection."""
        for end in (self._listener, self._connection):
            if end is not None:
                end.close()
        self._selector.close()

    def _accept(self) -> None:
        assert self._listener is not None
        self._drop()
        self._connection, _ = self._listener.accept()
        self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._selector.register(self._connection, selectors.EVENT_READ)

    def _read(self) -> None:
        assert self._connection is not None
        try:
            data = self._connection.recv(64)
        except OSError:
            data = b""
        self._received += data
        if not data:
            self._drop()
            if self._listener is None:
                raise VerdictError("lock step: the plant closed the connection")

    def _drop(self) -> None:
        if self._connection is not None:
            self._selector.unregister(self._connection)
            self._connection.close()
            self._connection, self._received = None, b""


def listen(address: str, link: Link) -> SideChannel:
    """Return the plant's end, which listens at ``HOST:PORT``; port 0 selects a free one.

    Raises:
        CanrollError: the address is wrong or taken.
    """
    try:
        return SideChannel(link, listener=socket.create_server(_place(address), backlog=1))
    except OSError as error:
        raise CanrollError(
            f"--side-channel {address}: cannot listen ({reason(error)}): choose another port"
        ) from error


def connect(address: str, link: Link) -> SideChannel:
    """Return the ECU's end, connected to the plant at ``HOST:PORT``; waits until it listens.

    Raises:
        CanrollError: the address is wrong, or nothing listens there.
    """
    place = _place(address)
    until = time.monotonic() + CONNECT
    while True:
        try:
            connection = socket.create_connection(place, timeout=CONNECT)
        except OSError as error:
            if time.monotonic() < until and isinstance(error, ConnectionRefusedError):
                time.sleep(0.1)
                continue
            raise CanrollError(
                f"--side-channel {address}: no plant is listening ({reason(error)}): "
                "start 'canroll plant --pace lockstep --side-channel HOST:PORT'"
            ) from error
        connection.settimeout(None)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return SideChannel(link, connection=connection)


def _place(address: str) -> tuple[str, int]:
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise CanrollError(f"--side-channel {address}: give HOST:PORT, such as 127.0.0.1:29537")
    return host, int(port)
