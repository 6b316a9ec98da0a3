"""A network in wall-clock time with a socketcand server on it."""

import math
import time
from collections import deque
from collections.abc import Callable
from threading import Thread
from typing import Any, Final

from canroll.plant_sim.can_bus.kernel.layout import Network
from canroll.plant_sim.can_bus.servers import SOCKETCAND_PORT
from canroll.plant_sim.can_bus.servers.hub import Hub, HubError, HubPort
from canroll.plant_sim.can_bus.servers.socketcand import MAX_CLIENTS, SocketcandServer

_IDLE_S: Final = 0.02


def serve_network(
    network: Network,
    *,
    host: str = "127.0.0.1",
    port: int = SOCKETCAND_PORT,
    announce: Callable[[str], Any] = print,
    duration_s: float | None = None,
) -> SocketcandServer:
    """Run a network in wall-clock time with a server on its segment 0, until interrupted.

    Args:
        network: at time 0; every client becomes a node on it.
        host: address to listen on.
        port: 0 takes a free one.
        announce: called once with how to connect.
        duration_s: stop after this time; None: only on KeyboardInterrupt.

    Returns:
        The closed server, for its counts.
    """
    with SocketcandServer(host=host, port=port) as server:
        hub = Hub(network)
        clients = [hub.open_port(queue="priority") for _ in range(MAX_CLIENTS)]
        for client in clients:
            # the server gives each what the listener hears
            client.entries = deque(maxlen=0)
        listener = hub.open_port()
        thread = Thread(target=_publish, args=(hub, listener, clients, server), daemon=True)
        thread.start()
        announce(
            f"bus '{server.channel}' on {server.address[0]}:{server.address[1]}, Ctrl-C ends it:\n"
            f"python -m can.viewer -i socketcand -c {server.channel} --bus-kwargs"
            f" host={server.address[0]} port={server.address[1]}"
        )
        end = math.inf if duration_s is None else time.monotonic() + duration_s
        try:
            while time.monotonic() < end:
                server.wait(_IDLE_S)
                for frame in server.take():
                    sender = clients[frame.client]
                    try:
                        hub.send(sender, frame.ident, frame.flags, frame.length, frame.payload)
                    except (HubError, ValueError):
                        # it is bus-off, its queue full, or it makes up ever new identifiers
                        server.dropped += 1
        except KeyboardInterrupt:
            lost = server.lost + listener.lost * server.clients
            announce(f"{lost} frames lost to slow clients, {server.refused} refused")
        finally:
            hub.close_port(listener)
            thread.join()
            hub.stop()
        return server


def _publish(hub: Hub, listener: HubPort, clients: list[HubPort], server: SocketcandServer) -> None:
    """Give the clients what the listener hears, until it is closed."""
    places = {client.node: place for place, client in enumerate(clients)}
    while (frame := hub.receive(listener, None)) is not None:
        if not frame.error:
            server.publish(
                frame.ident,
                frame.flags,
                frame.payload,
                length=frame.length,
                time_s=frame.time_s,
                sender=places.get(frame.sender, -1),
            )
