"""A server that speaks the socketcand protocol: unmodified python-can can connect.

``can.Bus("simbus", interface="socketcand", host="127.0.0.1", port=29536)``, ``python -m can.viewer
-i socketcand …``. Understood: ``open``, ``rawmode``, ``bcmmode`` with ``subscribe`` and
``unsubscribe``, ``send``, ``sendrtr``, ``echo`` (doc/protocol.md of linux-can/socketcand). Whatever
else comes in, malformed or too long, is answered with an error and the connection closed. A
client that does not read loses frames, which are counted, and is not read from beyond a backlog;
it never holds up the others or the bus. One that opens nothing within ten seconds is dropped. The
server listens on 127.0.0.1 by default.
"""

import contextlib
import selectors
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from canroll.errors import CanrollError, reason
from canroll.plant_sim.can_bus.servers import SOCKETCAND_PORT
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, FD, REMOTE

CLASSIC_LENGTH: Final = 8


class ClientFrame(NamedTuple):
    """A frame that a client sent; ``client`` is its place, 0 to ``MAX_CLIENTS − 1``."""

    client: int
    ident: int
    flags: int
    length: int
    payload: bytes


class ProtocolError(Exception):
    """A client violated the protocol."""


def parse_frame(words: list[str]) -> tuple[int, int, int, bytes]:
    """Return identifier, flags, length and payload of a ``send`` or ``sendrtr`` command.

    Raises:
        ProtocolError: it is not a frame that fits a classic CAN bus.
    """
    try:
        ident, length = int(words[1], 16), int(words[2], 16)
        payload = bytes(int(word, 16) for word in words[3:])
    except (IndexError, ValueError) as error:
        raise ProtocolError("malformed frame") from error
    flags = EXTENDED if len(words[1]) > 3 else 0
    remote = words[0] == "sendrtr"
    flags |= REMOTE if remote else 0
    if length > CLASSIC_LENGTH:
        raise ProtocolError("no frames of more than 8 bytes: the protocol has no CAN FD")
    fits = 0 <= ident < (1 << 29 if flags & EXTENDED else 1 << 11) and length >= 0
    if not fits or len(payload) != (0 if remote else length):
        raise ProtocolError("no such frame")
    return ident, flags, length, payload


def format_frame(ident: int, flags: int, time_s: float, payload: bytes, length: int) -> bytes:
    """Return a received frame as clients in raw mode read it."""
    name = f"{ident:08X}" if flags & EXTENDED else f"{ident:03X}"
    if flags & REMOTE:
        return f"< rtr {name} {time_s:.6f} {length} >".encode()
    return f"< frame {name} {time_s:.6f} {payload.hex().upper()} >".encode()


MAX_CLIENTS: Final = 16
_MAX_COMMAND: Final = 256
_BACKLOG_BYTES: Final = 1 << 18
_MAX_RECEIVED: Final = 4096
_QUIET_S: Final = 0.1
_MAX_SUBSCRIBED: Final = 2048
_PATIENCE_S: Final = 10.0
"""Time in which a client has to open the bus, and one that is refused to read why."""


@dataclass(slots=True, eq=False)
class _Client:
    place: int
    connection: socket.socket
    until: float
    received: bytearray = field(default_factory=bytearray)
    outgoing: bytearray = field(default_factory=bytearray)
    held: bytearray = field(default_factory=bytearray)
    opened: bool = False
    raw: bool = False
    quiet_until: float = 0.0
    subscribed: set[int] = field(default_factory=set)
    closing: bool = False


class SocketcandServer:
    """Accepts clients in a thread; ``publish`` to them, ``take`` what they send.

    Attributes:
        address: host and port it listens on.
        lost: frames that slow clients did not get.
        refused: connections closed because of malformed or oversized input.
        dropped: client frames dropped because they were not taken in time.
    """

    def __init__(
        self, *, channel: str = "simbus", host: str = "127.0.0.1", port: int = SOCKETCAND_PORT
    ) -> None:
        self.channel = channel
        self.lost = self.refused = self.dropped = 0
        self._clients: dict[int, _Client] = {}
        self._taken: deque[ClientFrame] = deque()
        self._lock = threading.Lock()
        self._activity = threading.Event()
        self._running = True
        self._selector = selectors.DefaultSelector()
        try:
            self._listener = socket.create_server((host, port), backlog=MAX_CLIENTS)
        except OSError as error:
            raise CanrollError(
                f"cannot listen on {host}:{port}: {reason(error)}: choose another port"
            ) from error
        self._listener.setblocking(False)
        self.address: tuple[str, int] = self._listener.getsockname()[:2]
        self._wake_read, self._wake_write = socket.socketpair()
        self._wake_read.setblocking(False)
        self._wake_write.setblocking(False)
        self._selector.register(self._listener, selectors.EVENT_READ, None)
        self._selector.register(self._wake_read, selectors.EVENT_READ, None)
        self._thread = threading.Thread(target=self._serve, name="socketcand", daemon=True)
        self._thread.start()

    def publish(
        self,
        ident: int,
        flags: int,
        payload: bytes,
        *,
        length: int,
        time_s: float,
        sender: int = -1,
    ) -> None:
        """Give a frame to every client but ``sender``; never waits.

        Raises:
            ValueError: an FD frame, of which the protocol has none.
        """
        if flags & FD:
            raise ValueError("socketcand has no CAN FD frames")
        with self._lock:
            now = time.monotonic()
            text = format_frame(ident, flags, time_s, payload, length)
            for client in self._clients.values():
                if client.place == sender or client.closing:
                    continue
                if not client.raw and ident not in client.subscribed:
                    continue
                if len(client.outgoing) + len(client.held) + len(text) > _BACKLOG_BYTES:
                    self.lost += 1
                elif client.held or now < client.quiet_until:
                    client.held += text
                else:
                    client.outgoing += text
        self._wake()

    def take(self) -> list[ClientFrame]:
        """Return the frames that clients have sent since the last call."""
        with self._lock:
            taken = list(self._taken)
            self._taken.clear()
            self._activity.clear()
            return taken

    def wait(self, timeout_s: float) -> bool:
        """Wait until a client has sent something, at most ``timeout_s``."""
        return self._activity.wait(timeout_s)

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        return len(self._clients)

    def close(self) -> None:
        """Disconnect everybody and free the port."""
        self._running = False
        self._wake()
        self._thread.join()

    def __enter__(self) -> "SocketcandServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _wake(self) -> None:
        with contextlib.suppress(BlockingIOError, OSError):
            self._wake_write.send(b"\0")

    def _serve(self) -> None:
        while self._running:
            holding = any(client.held for client in self._clients.values())
            for key, events in self._selector.select(timeout=_QUIET_S if holding else 0.5):
                if key.fileobj is self._listener:
                    self._accept()
                elif key.fileobj is self._wake_read:
                    with contextlib.suppress(BlockingIOError):
                        self._wake_read.recv(4096)
                else:
                    self._handle(key.data, events)
            for client in list(self._clients.values()):
                self._flush(client)
                if (client.closing or not client.opened) and time.monotonic() > client.until:
                    self.refused += not client.closing
                    self._drop(client)
        for client in list(self._clients.values()):
            self._drop(client)
        for end in (self._listener, self._wake_read, self._wake_write):
            end.close()
        self._selector.close()

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        free = sorted(set(range(MAX_CLIENTS)) - set(self._clients))
        connection.setblocking(False)
        if not free:
            self.refused += 1
            connection.close()
            return
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(free[0], connection, time.monotonic() + _PATIENCE_S)
        client.outgoing += b"< hi >"
        with self._lock:
            self._clients[client.place] = client
        self._selector.register(connection, selectors.EVENT_READ, client)

    def _handle(self, client: _Client, events: int) -> None:
        if not events & selectors.EVENT_READ:
            return
        try:
            data = client.connection.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        client.received += data
        try:
            self._parse(client)
        except ProtocolError as error:
            self.refused += 1
            with self._lock:
                client.outgoing += f"< error {error} >".encode()
                client.closing, client.until = True, time.monotonic() + _PATIENCE_S

    def _parse(self, client: _Client) -> None:
        while not client.closing:
            text = client.received.lstrip()
            if not text:
                client.received.clear()
                return
            end = text.find(b">")
            if text[0] != ord("<") or max(end, 0 if end >= 0 else len(text)) > _MAX_COMMAND:
                raise ProtocolError("malformed or oversized command")
            if end < 0:
                client.received = text
                return
            client.received = text[end + 1 :]
            try:
                words = text[1:end].decode("ascii").split()
            except UnicodeDecodeError as error:
                raise ProtocolError("not ASCII") from error
            self._execute(client, words)

    def _execute(self, client: _Client, words: list[str]) -> None:
        command = words[0] if words else ""
        reply = b""
        if command == "echo":
            reply = b"< echo >"
        elif not client.opened:
            if command != "open" or words[1:] != [self.channel]:
                raise ProtocolError("no such bus")
            client.opened, reply = True, b"< ok >"
        elif command in {"rawmode", "bcmmode"}:
            reply = b"< ok >"
        elif command in {"send", "sendrtr"}:
            received = ClientFrame(client.place, *parse_frame(words))
            with self._lock:
                if len(self._taken) < _MAX_RECEIVED:
                    self._taken.append(received)
                else:
                    self.dropped += 1
            self._activity.set()
        elif command in {"subscribe", "unsubscribe"}:
            try:
                ident = int(words[-1], 16)
            except ValueError as error:
                raise ProtocolError("malformed identifier") from error
            if not 0 <= ident < 1 << 29:
                raise ProtocolError("an identifier has at most 29 bits")
            if command == "subscribe" and len(client.subscribed) >= _MAX_SUBSCRIBED:
                raise ProtocolError(f"at most {_MAX_SUBSCRIBED} identifiers")
            with self._lock:
                (client.subscribed.add if command == "subscribe" else client.subscribed.discard)(
                    ident
                )
        else:
            raise ProtocolError("unknown command")
        with self._lock:
            client.outgoing += reply
            if command in {"rawmode", "bcmmode"}:
                client.raw = command == "rawmode"
                # what was kept is of the mode before, by other rules of what the client hears
                client.held.clear()
                # clients take the reply alone: frames in the same segment would confuse them, so
                # they wait until then
                client.quiet_until = time.monotonic() + _QUIET_S

    def _flush(self, client: _Client) -> None:
        with self._lock:
            if client.held and time.monotonic() >= client.quiet_until:
                client.outgoing += client.held
                client.held.clear()
            try:
                if client.outgoing:
                    sent = client.connection.send(client.outgoing)
                    del client.outgoing[:sent]
            except BlockingIOError:
                pass
            except OSError:
                client.closing = True
                client.outgoing.clear()
            done = client.closing and not client.outgoing
            events = selectors.EVENT_WRITE if client.outgoing else 0
            if len(client.outgoing) + len(client.held) <= _BACKLOG_BYTES:
                events |= selectors.EVENT_READ
        if done:
            self._drop(client)
        elif client.place in self._clients:
            self._selector.modify(client.connection, events, client)

    def _drop(self, client: _Client) -> None:
        with self._lock:
            if self._clients.pop(client.place, None) is None:
                return
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(client.connection)
        client.connection.close()
