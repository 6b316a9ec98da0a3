"""A network in wall-clock time with a socketcand server on it."""

import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from plant_sim.can_bus.kernel.layout import DELIVERED, MAX_PAYLOAD, NOW, REFUSED, Network
from plant_sim.can_bus.kernel.ledger import drain
from plant_sim.can_bus.kernel.network import Node, add_node
from plant_sim.can_bus.kernel.queues import enqueue
from plant_sim.can_bus.kernel.scheduler import advance, next_event_ns
from plant_sim.can_bus.servers import SOCKETCAND_PORT
from plant_sim.can_bus.servers.socketcand import MAX_CLIENTS, SocketcandServer

_PIECE_NS: Final = 100_000_000
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
    first = int(add_node(network, Node("client0", policy="priority")))
    for place in range(1, MAX_CLIENTS):
        add_node(network, Node(f"client{place}", policy="priority"))
    buffer = np.zeros(MAX_PAYLOAD, np.uint8)
    cursor = 0
    with SocketcandServer(host=host, port=port) as server:
        announce(
            f"bus '{server.channel}' on {server.address[0]}:{server.address[1]}, Ctrl-C ends it:\n"
            f"python -m can.viewer -i socketcand -c {server.channel} --bus-kwargs"
            f" host={server.address[0]} port={server.address[1]}"
        )
        epoch, origin = time.time(), time.monotonic_ns()
        try:
            while True:
                elapsed = time.monotonic_ns() - origin
                if duration_s is not None and elapsed > duration_s * 1e9:
                    break
                for frame in server.take():
                    buffer[: len(frame.payload)] = np.frombuffer(frame.payload, np.uint8)
                    when = max(elapsed, int(network.clock[NOW]))
                    node = first + frame.client
                    try:
                        enqueue(network, node, when, frame.ident, frame.length, buffer, frame.flags)
                    except ValueError:  # a client that makes up ever new identifiers
                        server.dropped += 1
                while int(network.clock[NOW]) < elapsed:
                    advance(network, min(int(network.clock[NOW]) + _PIECE_NS, elapsed))
                    entries, cursor, missed = drain(network, cursor)
                    server.lost += missed * server.clients
                    for entry in entries[np.isin(entries["outcome"], (DELIVERED, REFUSED))]:
                        length = int(entry["length"])
                        server.publish(
                            int(entry["ident"]),
                            int(entry["flags"]),
                            bytes(entry["payload"][:length]),
                            length=length,
                            time_s=epoch + int(entry["t_received"]) * 1e-9,
                            sender=int(entry["sender"]) - first,
                        )
                pause = (int(next_event_ns(network)) - elapsed) * 1e-9
                server.wait(min(max(pause, 0.0), _IDLE_S))
        except KeyboardInterrupt:
            announce(f"{server.lost} frames lost to slow clients, {server.refused} refused")
        return server
