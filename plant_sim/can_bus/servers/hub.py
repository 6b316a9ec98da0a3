"""A network that several programs' ports share, in virtual or in wall-clock time.

Virtual time moves only while a port waits for a frame or is told to let time pass, from event to
event and as fast as the machine can: with one thread the same calls give the same frames. In
wall-clock time a thread keeps the network at the present.
"""

import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from plant_sim.can_bus.kernel.layout import (
    BUS_OFF,
    DELIVERED,
    ERROR,
    ERROR_ACTIVE,
    MAX_PAYLOAD,
    NEVER,
    NOW,
    Network,
)
from plant_sim.can_bus.kernel.ledger import drain
from plant_sim.can_bus.kernel.network import Node, add_node
from plant_sim.can_bus.kernel.queues import enqueue
from plant_sim.can_bus.kernel.scheduler import advance, next_event_ns

RECEIVE_QUEUE: Final = 1 << 16
TRANSMIT_QUEUE: Final = 256
_PIECE_NS: Final = 100_000_000
_IDLE_S: Final = 0.05


@dataclass(slots=True, eq=False)
class Port:
    """One program's node on a hub.

    ``lost`` counts frames it was too slow to take, ``outstanding`` those it sent that are not at
    their end.
    """

    node: int
    receive_own: bool = False
    entries: deque[Any] = field(default_factory=deque)
    lost: int = 0
    outstanding: int = 0


class Hub:
    """Owner of a network; all methods may be called from any thread."""

    def __init__(self, network: Network, *, virtual_time: bool = False) -> None:
        self.network = network
        self.virtual_time = virtual_time
        self.ports: list[Port] = []
        self._spare: list[int] = []
        self._cursor = 0
        self._lock = threading.Lock()
        self._arrived = threading.Condition(self._lock)
        self._changed = threading.Condition(self._lock)
        self._origin_ns = time.monotonic_ns()
        self.epoch_s = 0.0 if virtual_time else time.time()
        self._running = not virtual_time
        self._thread: threading.Thread | None = None
        if not virtual_time:
            self._thread = threading.Thread(target=self._pump, name="simbus", daemon=True)
            self._thread.start()

    def open_port(self, *, receive_own: bool = False) -> Port:
        """Return a new node on segment 0."""
        with self._lock:
            if self._spare:
                node = self._spare.pop()
                record = self.network.nodes[node : node + 1]
                record["state"], record["recovers"] = ERROR_ACTIVE, 1
                record["transmit_errors"] = record["receive_errors"] = 0
            else:
                node = add_node(self.network, Node("port", policy="priority"))
            port = Port(node, receive_own)
            self.ports.append(port)
            return port

    def close_port(self, port: Port) -> bool:
        """Take a port off the bus; what it has queued is still sent. True if it was the last."""
        with self._lock:
            if port in self.ports:
                self.ports.remove(port)
                self._spare.append(port.node)
                # off for good: it neither acknowledges nor recovers
                self.network.nodes["state"][port.node] = BUS_OFF
                self.network.nodes["recovers"][port.node] = 0
            return not self.ports

    def stop(self) -> None:
        """End the thread of a wall-clock hub."""
        with self._lock:
            self._running = False
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()

    def now_ns(self) -> int:
        """Return the bus time: virtual, or since the hub was made."""
        if self.virtual_time:
            return int(self.network.clock[NOW])
        return time.monotonic_ns() - self._origin_ns

    def send(self, port: Port, ident: int, flags: int, length: int, payload: bytes) -> bool:
        """Queue a frame now; False where the port's transmit queue is full."""
        buffer = np.zeros(MAX_PAYLOAD, np.uint8)
        buffer[: len(payload)] = np.frombuffer(payload, np.uint8)
        with self._lock:
            if port.outstanding >= TRANSMIT_QUEUE:
                return False
            # the thread may have brought the bus a little beyond this moment
            when = max(self.now_ns(), int(self.network.clock[NOW]))
            accepted = bool(enqueue(self.network, port.node, when, ident, length, buffer, flags))
            port.outstanding += accepted
            self._changed.notify()
            return accepted

    def receive(self, port: Port, timeout_s: float | None) -> Any | None:  # noqa: ANN401
        """Return the next log entry for ``port``, None after ``timeout_s`` (None: no limit)."""
        with self._lock:
            if self.virtual_time:
                limit = NEVER if timeout_s is None else self.now_ns() + round(timeout_s * 1e9)
                self._run_until(limit, port)
            else:
                self._arrived.wait_for(lambda: port.entries or not self._running, timeout_s)
            return port.entries.popleft() if port.entries else None

    def let_pass(self, duration_s: float) -> None:
        """Let time pass: move virtual time on, or sleep."""
        if not self.virtual_time:
            time.sleep(duration_s)
            return
        with self._lock:
            self._run_until(self.now_ns() + round(duration_s * 1e9), None)

    def node_state(self, port: Port) -> tuple[int, int, int]:
        """Return the port's error state, transmit and receive error counters."""
        node = self.network.nodes[port.node]
        return int(node["state"]), int(node["transmit_errors"]), int(node["receive_errors"])

    def _run_until(self, limit_ns: int, port: Port | None) -> None:
        """Go from event to event up to ``limit_ns``, or until ``port`` has a frame."""
        while port is None or not port.entries:
            when = int(next_event_ns(self.network))
            if when > limit_ns or when >= NEVER:
                if limit_ns < NEVER:
                    advance(self.network, limit_ns)
                return
            advance(self.network, when)
            self._distribute()

    def _distribute(self) -> None:
        entries, self._cursor, missed = drain(self.network, self._cursor)
        for port in self.ports:
            port.lost += missed
        for entry in entries:
            seen = entry["outcome"] in (DELIVERED, ERROR)
            for port in self.ports:
                own = entry["sender"] == port.node
                if own and entry["outcome"] != ERROR:
                    port.outstanding -= 1
                if not seen or (own and not port.receive_own):
                    continue
                if len(port.entries) >= RECEIVE_QUEUE:
                    port.lost += 1
                else:
                    port.entries.append(entry)

    def _pump(self) -> None:
        with self._lock:
            while self._running:
                target = self.now_ns()
                while int(self.network.clock[NOW]) < target:
                    step = int(self.network.clock[NOW]) + _PIECE_NS
                    advance(self.network, min(step, target))
                    before = self._cursor
                    self._distribute()
                    if self._cursor != before:
                        self._arrived.notify_all()
                pause = (int(next_event_ns(self.network)) - self.now_ns()) * 1e-9
                self._changed.wait(min(max(pause, 0.0), _IDLE_S))
