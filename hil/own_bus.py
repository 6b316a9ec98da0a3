"""The plant's own bus, which connects python-can programs with the world on this machine.

It is a socketcand server: clients connect with ``-i socketcand``, the ECU, ``canroll watch``,
can_logger and can_viewer, several at a time. Every client gets every frame but its own, as on vcan.
socketcand has no CAN FD frames (linux-can/socketcand, issue 12), so a bus that has them is a
multicast group that no frame leaves this machine by.
"""

import socket
import time
from collections import deque

from canroll.errors import CanrollError, reason
from canroll.hil.bus_link import EXTENDED, NOTES, Frame
from canroll.plant_sim.can_bus.servers import SOCKETCAND_PORT
from canroll.plant_sim.can_bus.servers.socketcand import SocketcandServer
from canroll.plant_sim.can_bus.wire import frame as wire

CHANNEL = "plant"
GROUP = "239.74.163.21"
"""Multicast address of private buses with CAN FD frames, each with its port."""
NOT_SERVED = "socketcand has no CAN FD frames, which this bus has"
"""Why there is no server for such a bus."""


class OwnBus:
    """A link to the clients of a server; as it is not a real bus, it keeps no record."""

    record = None

    def __init__(self, server: SocketcandServer) -> None:
        self._server = server
        self._waiting: deque[Frame] = deque()
        self.sent = self.received = 0

    @property
    def failed(self) -> int:
        """Frames dropped because clients were too slow."""
        return self._server.lost

    @property
    def options(self) -> str:
        """python-can's options for connecting."""
        host, port = self._server.address
        return f"-i socketcand -c {CHANNEL} --bus-kwargs host={host} port={port}"

    def receive(self) -> list[Frame]:
        """Return the clients' frames, forwarding them to all others."""
        self._take()
        frames = [frame for frame in self._waiting if frame[0] not in NOTES]
        self._waiting.clear()
        return frames

    def next(self, timeout: float) -> Frame | None:
        """Return the next data frame, or None after ``timeout`` seconds."""
        if not self._waiting and self._server.wait(timeout):
            self._take()
        return self._waiting.popleft() if self._waiting else None

    def _take(self) -> None:
        for frame in self._server.take():
            self._server.publish(
                frame.ident,
                frame.flags,
                frame.payload,
                length=frame.length,
                time_s=time.time(),
                sender=frame.client,
            )
            if not frame.flags & ~wire.EXTENDED:
                ident = frame.ident | (EXTENDED if frame.flags else 0)
                self.received += ident not in NOTES
                self._waiting.append((ident, frame.payload))

    def send(self, ident: int, payload: bytes) -> None:
        """Send a frame to every client."""
        flags = wire.EXTENDED if ident & EXTENDED else 0
        self._server.publish(
            ident & ~EXTENDED, flags, payload, length=len(payload), time_s=time.time()
        )
        self.sent += ident not in NOTES

    def wait(self, timeout: float) -> bool:
        """Wait until a client has sent a frame, at most ``timeout`` s."""
        return self._server.wait(timeout)

    def close(self) -> None:
        """End all connections."""
        self._server.close()


def serve(address: str) -> OwnBus:
    """Open the bus at ``HOST:PORT``; port 0 takes a free one.

    Raises:
        CanrollError: the address is wrong or taken.
    """
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise CanrollError(
            f"--serve {address}: give HOST:PORT, such as 127.0.0.1:{SOCKETCAND_PORT}"
        )
    return OwnBus(SocketcandServer(channel=CHANNEL, host=host, port=int(port)))


def fd_options() -> list[str]:
    """Return python-can's options of a private bus with CAN FD frames, on a port that is free.

    Raises:
        CanrollError: this machine has no route for multicast.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        trial.bind(("", 0))
        trial.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        port = trial.getsockname()[1]
        try:
            trial.sendto(b"", (GROUP, port))
        except OSError as error:
            raise CanrollError(
                f"no multicast on this machine ({reason(error)}), by which CAN FD frames go: give "
                "an interface, such as -i socketcan -c vcan0 --fd"
            ) from error
    options = f"-i udp_multicast -c {GROUP} --fd --bus-kwargs port={port} hop_limit=0"
    return options.split()
