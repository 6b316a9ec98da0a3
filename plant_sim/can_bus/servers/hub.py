"""A network shared by the ports of several programs, in virtual or wall-clock time.

Virtual time advances only while a port waits for a frame or for room in its queue, or lets time
pass: from event to event, as fast as possible. With one thread the same calls give the same frames;
several threads take turns. In wall-clock time a thread keeps the network at the present time.
"""

import threading
import time
from collections import deque
from dataclasses import dataclass, field
from struct import Struct
from typing import Final, NamedTuple

import numpy as np

from canroll.plant_sim.can_bus.kernel.layout import (
    BUS_OFF,
    DELIVERED,
    ERROR,
    ERROR_ACTIVE,
    FREE_FRAME,
    LOGGED,
    MAX_PAYLOAD,
    NOW,
    REFUSED,
    RELEASES,
    Network,
)
from canroll.plant_sim.can_bus.kernel.network import POLICIES, Node, add_node
from canroll.plant_sim.can_bus.kernel.queues import enqueue
from canroll.plant_sim.can_bus.kernel.scheduler import advance, advance_to_entry, next_event_ns
from canroll.plant_sim.can_bus.wire.frame import ERROR_FLAG, ERROR_FRAME_BITS, ERROR_STATE, FD
from canroll.plant_sim.kernels.instants import NEVER

RECEIVE_QUEUE: Final = 1 << 16
TRANSMIT_QUEUE: Final = 256
_PIECE_NS: Final = 100_000_000
_IDLE_S: Final = 0.05
_STEPS_A_TURN: Final = 256
_ENTRY: Final = Struct("<5qIh4BHh64s")
"""A log entry, see ``log_dtype``: reading it this way is ten times as fast as with NumPy."""


class HubError(Exception):
    """A frame could not be sent."""


class QueueFullError(HubError):
    """The transmit queue stayed full until the timeout."""


class PortFrame(NamedTuple):
    """A frame as received by a port; ``error``: destroyed by an error, or only an error flag."""

    time_s: float
    ident: int
    flags: int
    payload: bytes
    length: int
    error: bool
    sender: int


@dataclass(slots=True, eq=False)
class HubPort:
    """One program's node on a hub.

    ``lost``: frames it did not read in time; ``outstanding``: frames it has sent that are still
    pending; ``stamps``: the program's time stamps of these, by identifier and flags.
    """

    node: int
    receive_own: bool = False
    fd: bool = True
    open: bool = True
    entries: deque[PortFrame] = field(default_factory=deque)
    lost: int = 0
    outstanding: int = 0
    stamps: dict[tuple[int, int], deque[float]] = field(default_factory=dict)


class Hub:
    """Owner of a network; all methods may be called from any thread.

    Attributes:
        unacknowledged: a node alone on the bus has sent a frame that no node acknowledges;
            ``warned``: the warning has been issued.
    """

    def __init__(self, network: Network, *, virtual_time: bool = False) -> None:
        self.network = network
        self.virtual_time = virtual_time
        self.ports: list[HubPort] = []
        self.unacknowledged = self.warned = False
        self._clock = network.clock
        self._nodes = network.part("nodes")
        self._states = self._nodes["state"]
        self._log = network.log.view(np.uint8).data
        self._buffer = np.zeros(MAX_PAYLOAD, np.uint8)
        self._bytes = self._buffer.data
        self._spare: list[int] = []
        self._cursor = 0
        self._lock = threading.Lock()
        self._arrived = threading.Condition(self._lock)
        self._room = threading.Condition(self._lock)
        self._changed = threading.Condition(self._lock)
        self._origin_ns = time.monotonic_ns()
        self.epoch_s = 0.0 if virtual_time else time.time()
        self._running = not virtual_time
        self._thread: threading.Thread | None = None
        if not virtual_time:
            self._thread = threading.Thread(target=self._pump, name="simbus", daemon=True)
            self._thread.start()

    def open_port(
        self, *, receive_own: bool = False, fd: bool = True, queue: str = "fifo"
    ) -> HubPort:
        """Return a new node on segment 0; ``queue``: a policy of ``Node``, ``fd``: it receives FD.

        Raises:
            CanrollError: there is no room for another node.
        """
        with self._lock:
            free = [node for node in self._spare if self._nodes["pending"][node] == 0]
            if free:
                node = free[0]
                self._spare.remove(node)
                record = self._nodes[node : node + 1]
                record["state"], record["recovers"] = ERROR_ACTIVE, 1
                record["transmit_errors"] = record["receive_errors"] = 0
                record["policy"] = POLICIES[queue]
            else:
                node = add_node(self.network, Node("port", policy=queue, capacity=TRANSMIT_QUEUE))
            port = HubPort(node, receive_own, fd)
            self.ports.append(port)
            return port

    def close_port(self, port: HubPort) -> bool:
        """Remove a port; its queued frames are still sent. Return True if it was the last."""
        with self._lock:
            if port in self.ports:
                # a node that is off takes no more into its queue: accept what is on its way
                advance(self.network, max(self.now_ns(), int(self._clock[NOW])))
                self._distribute()
                self.ports.remove(port)
                port.open = False
                self._spare.append(port.node)
                # off for good: it neither acknowledges nor recovers
                self._states[port.node] = BUS_OFF
                self._nodes["recovers"][port.node] = 0
                self._arrived.notify_all()
                self._room.notify_all()
            return not self.ports

    def stop(self) -> None:
        """End the thread of a wall-clock hub."""
        with self._lock:
            self._running = False
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()

    def now_ns(self) -> int:
        """Return the bus time, ns: virtual, or since the hub was created."""
        if self.virtual_time:
            return int(self._clock[NOW])
        return time.monotonic_ns() - self._origin_ns

    def send(
        self,
        port: HubPort,
        ident: int,
        flags: int,
        length: int,
        payload: bytes,
        *,
        timeout_s: float | None = 0.0,
        stamp_s: float | None = None,
    ) -> None:
        """Queue a frame, or an error flag, as soon as the port's transmit queue has room.

        Args:
            port: of the sender.
            ident: its identifier.
            flags: its wire flags; ``ERROR_FLAG`` for an error flag.
            length: payload bytes.
            payload: the payload, empty for remote frames.
            timeout_s: longest wait for room in the queue, s; None: no limit.
            stamp_s: time stamp for receivers instead of the time of reception, s.

        Raises:
            QueueFullError: the queue stayed full until the timeout.
            HubError: the node is bus-off or has left the bus, or no node can acknowledge.
            ValueError: the network has no room for another identifier.
        """
        with self._lock:
            if not self._has_room(port):
                self._wait_for_room(port, timeout_s)
            self._bytes[: len(payload)] = payload
            # the thread may have brought the bus a little beyond this moment
            when = max(self.now_ns(), int(self._clock[NOW]))
            bits = ERROR_FRAME_BITS if flags & ERROR_FLAG else 0
            enqueue(self.network, port.node, when, ident, length, self._buffer, flags, bits)
            port.outstanding += 1
            if stamp_s is not None:
                key = ident, flags & ~ERROR_STATE
                port.stamps.setdefault(key, deque()).append(stamp_s)
            self._changed.notify()

    def receive(self, port: HubPort, timeout_s: float | None) -> PortFrame | None:
        """Return the next frame for ``port``, None after ``timeout_s`` (None: no limit)."""
        with self._lock:
            if not port.entries and self.virtual_time:
                self._run_until(self._limit(timeout_s), port)
            elif not port.entries:
                self._arrived.wait_for(lambda: port.entries or not port.open, timeout_s)
            return port.entries.popleft() if port.entries else None

    def let_pass(self, duration_s: float) -> None:
        """Advance virtual time, or sleep."""
        if not self.virtual_time:
            time.sleep(duration_s)
            return
        with self._lock:
            self._run_until(self._limit(duration_s), None)

    def node_state(self, port: HubPort) -> tuple[int, int, int]:
        """Return the port's error state, transmit and receive error counters."""
        node = self._nodes[port.node]
        return int(node["state"]), int(node["transmit_errors"]), int(node["receive_errors"])

    def _limit(self, timeout_s: float | None) -> int:
        return NEVER if timeout_s is None else self.now_ns() + round(timeout_s * 1e9)

    def _has_room(self, port: HubPort) -> bool:
        if not port.open:
            raise HubError("the bus has been shut down")
        if self._states[port.node] == BUS_OFF:
            raise HubError("the node is bus-off")
        return port.outstanding < TRANSMIT_QUEUE and self._clock[FREE_FRAME] >= 0

    def _wait_for_room(self, port: HubPort, timeout_s: float | None) -> None:
        limit = self._limit(timeout_s)
        turn = 0
        while not self._has_room(port):
            if self.now_ns() >= limit:
                raise QueueFullError("transmit queue full")
            if not self.virtual_time:
                left = None if timeout_s is None else (limit - self.now_ns()) * 1e-9
                self._room.wait(left)
            elif limit >= NEVER and self._stuck():
                raise HubError("transmit queue full, and no node acknowledges its frames")
            else:
                turn = self._step(limit, turn)

    def _stuck(self) -> bool:
        """Return whether only retransmissions of a lone node are left (lock held)."""
        count = len(self.network.nodes)
        there = (self._states[:count] != BUS_OFF) | (self._nodes["recovers"][:count] != 0)
        return int(there.sum()) < 2 and self._clock[RELEASES] == 0

    def _run_until(self, limit_ns: int, port: HubPort | None) -> None:
        """Advance by events to ``limit_ns``, or until ``port`` has a frame or closes."""
        turn = 0
        while port is None or (port.open and not port.entries):
            reached = int(self._clock[NOW]) >= limit_ns and turn > 0
            if reached or (limit_ns >= NEVER and self._stuck()):
                return
            before = self._cursor
            turn = self._step(limit_ns, turn)
            if self._cursor == before and limit_ns >= NEVER:
                return

    def _step(self, limit_ns: int, turn: int) -> int:
        """Advance to the next log entry or to the limit, and yield to other threads."""
        if advance_to_entry(self.network, limit_ns):
            self._distribute()
        if (turn + 1) % _STEPS_A_TURN == 0:
            self._lock.release()
            time.sleep(0.0)
            self._lock.acquire()
        return turn + 1

    def _distribute(self) -> None:
        """Distribute logged frames to the ports (lock held)."""
        total, size = int(self._clock[LOGGED]), len(self.network.log)
        missed = max(0, total - size - self._cursor)
        for port in self.ports if missed else ():
            port.lost += missed
        for number in range(self._cursor + missed, total):
            fields = _ENTRY.unpack_from(self._log, number % size * _ENTRY.size)
            _, _, _, received, _, ident, sender, _, flags, length, outcome, _, missed, payload = (
                fields
            )
            time_s = self.epoch_s + received * 1e-9
            if outcome == ERROR:
                self.unacknowledged = self.unacknowledged or self._stuck()
                frame = PortFrame(time_s, 0, 0, b"", 0, True, sender)
            else:
                if outcome != REFUSED:
                    time_s = self._finished(sender, ident, flags, time_s)
                broken = bool(flags & ERROR_FLAG)
                frame = PortFrame(time_s, ident, flags, payload[:length], length, broken, sender)
            if outcome in (DELIVERED, REFUSED, ERROR):
                self._give(frame, missed)
        if total > self._cursor:
            self._arrived.notify_all()
            self._room.notify_all()
        self._cursor = total

    def _finished(self, sender: int, ident: int, flags: int, time_s: float) -> float:
        """Count a finished frame; return its time stamp."""
        for port in self.ports:
            if port.node == sender:
                port.outstanding -= 1
                stamps = port.stamps.get((ident, flags & ~ERROR_STATE)) if port.stamps else None
                return stamps.popleft() if stamps else time_s
        return time_s

    def _give(self, frame: PortFrame, missed: int) -> None:
        for port in self.ports:
            own = port.node == frame.sender and not port.receive_own
            if own or port.node == missed:
                continue
            if not port.fd and frame.flags & FD:
                continue
            if len(port.entries) >= RECEIVE_QUEUE:
                port.lost += 1
            else:
                port.entries.append(frame)

    def _pump(self) -> None:
        with self._lock:
            while self._running:
                target = self.now_ns()
                while int(self._clock[NOW]) < target:
                    advance(self.network, min(int(self._clock[NOW]) + _PIECE_NS, target))
                    self._distribute()
                pause = (int(next_event_ns(self.network)) - self.now_ns()) * 1e-9
                self._changed.wait(min(max(pause, 0.0), _IDLE_S))
