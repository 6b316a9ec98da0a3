"""A bus shared by several programs over TCP in lock step: time passes only while all wait.

The bus stands still while a program runs. When all of them wait, for a frame or for a time, it
advances to the first instant at which one of them continues. Frames sent at one instant are queued
in the order of the programs' names, so that the same programs give the same frames on any machine.
In real time the bus also waits for the clock.
"""

import hmac
import selectors
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final

from canroll.errors import CanrollError
from plant_sim.can_bus.kernel.layout import BUS_OFF, Network
from plant_sim.can_bus.servers import SHARED_PORT
from plant_sim.can_bus.servers.hub import Hub, HubError, HubPort, PortFrame
from plant_sim.can_bus.servers.shared_protocol import (
    LEAVE,
    MAX_LINE,
    Question,
    Reply,
    parse_line,
    read_question,
    send_answer,
    send_line,
)

GREETING_S: Final = 5.0
"""Time in which a connection has to say which program it is."""
MAX_CONNECTIONS: Final = 64


@dataclass(slots=True, eq=False)
class _Caller:
    """A connection that has not said yet which program it is, and has to until a time."""

    connection: socket.socket
    until: float
    line: bytes = b""
    answered: bool = False
    joined: bool = False


@dataclass(slots=True, eq=False)
class _Program:
    """A program: its connection, its node, and the time until which it waits, None: it runs."""

    name: str
    connection: socket.socket
    options: dict[str, Any]
    port: HubPort = field(init=False)
    until_ns: int | None = None
    refused: int = 0


class SharedBus:
    """Server that waits for all programs, runs the bus, and ends when the last one leaves.

    Args:
        network: at time 0; every program becomes a node on its segment 0.
        programs: number of programs.
        host: address to listen on.
        port: to listen on, 0: a free one.
        real_time: bus time does not run ahead of the clock.
        mirror: called with every finished frame.
        token: that programs have to give as they join; "": none.

    Raises:
        CanrollError: the address is not available.
    """

    def __init__(
        self,
        network: Network,
        *,
        programs: int,
        host: str = "127.0.0.1",
        port: int = SHARED_PORT,
        real_time: bool = False,
        mirror: Callable[[PortFrame], Any] | None = None,
        token: str = "",
    ) -> None:
        self._token = token
        self._hub = Hub(network, virtual_time=True)
        self._expected, self._real_time, self._mirror = programs, real_time, mirror
        self._watching = self._hub.open_port() if mirror is not None else None
        self._programs: list[_Program] = []
        try:
            self._listener = socket.create_server((host, port))
        except (OSError, OverflowError) as error:
            raise CanrollError(f"cannot listen on {host}:{port}: {error}") from error
        self.address: tuple[str, int] = self._listener.getsockname()[:2]

    def run(self) -> int:
        """Serve until the last program has left; return the bus time, ns."""
        try:
            self._gather()
            began = time.monotonic_ns()
            while True:
                for program in list(self._programs):
                    if program.until_ns is None:
                        self._ask(program)
                if not self._programs:
                    return self._hub.now_ns()
                over = self._go_on()
                if self._real_time and not over:
                    ahead = began + self._hub.now_ns() - time.monotonic_ns()
                    time.sleep(max(0, ahead) * 1e-9)
                self._answer(over=over)
        finally:
            self.close()

    def close(self) -> None:
        """Close all connections."""
        self._listener.close()
        for program in self._programs:
            program.connection.close()

    def _gather(self) -> None:
        """Wait for all programs, and add their nodes in the order of their names."""
        joined: dict[str, _Program] = {}
        callers: list[_Caller] = []
        with selectors.DefaultSelector() as selector:
            selector.register(self._listener, selectors.EVENT_READ)
            while len(joined) < self._expected:
                for key, _ in selector.select(timeout=0.5):
                    if key.fileobj is not self._listener:
                        self._hear(key.data, joined)
                        continue
                    connection, _ = self._listener.accept()
                    callers.append(_Caller(connection, time.monotonic() + GREETING_S))
                    selector.register(connection, selectors.EVENT_READ, callers[-1])
                for caller in list(callers):
                    late = time.monotonic() > caller.until or len(callers) > MAX_CONNECTIONS
                    if late or caller.answered:
                        selector.unregister(caller.connection)
                        callers.remove(caller)
                        if not caller.joined:
                            caller.connection.close()
        for caller in callers:
            caller.connection.close()
        self._programs = [joined[name] for name in sorted(joined)]
        for program in self._programs:
            program.port = self._hub.open_port(
                receive_own=bool(program.options.get("receive_own")),
                fd=bool(program.options.get("fd")),
            )
            with suppress(OSError):
                send_line(program.connection, {"node": program.port.node})

    def _hear(self, caller: _Caller, joined: dict[str, _Program]) -> None:
        """Read on what a connection says; let it join, or refuse it, once it has said all."""
        connection = caller.connection
        try:
            part = connection.recv(MAX_LINE)
            caller.line += part
            if part and not caller.line.endswith(b"\n") and len(caller.line) <= MAX_LINE:
                return
            caller.answered = True
            options = parse_line(caller.line)
            name, token = str(options["name"]), str(options.get("token", ""))
            if not hmac.compare_digest(token.encode(), self._token.encode()):
                send_line(connection, {"error": "the token is not the one that the bus shows"})
            elif name in joined:
                taken = f"a program '{name}' is on the bus already: name this one by node=NAME"
                send_line(connection, {"error": f"{taken} (--bus-kwargs node=NAME)"})
            elif len(joined) == self._expected:
                send_line(connection, {"error": "all programs are on the bus already"})
            else:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                joined[name], caller.joined = _Program(name, connection, options), True
        except (KeyError, OSError, ValueError):
            caller.answered = True

    def _ask(self, program: _Program) -> None:
        """Read the question of a program; remove a program that leaves."""
        try:
            question = read_question(program.connection)
        except (ConnectionError, OSError):
            question = Question(LEAVE, [])
        for frame in question.frames:
            try:
                payload = frame.payload[: frame.length]
                self._hub.send(program.port, frame.ident, frame.flags, frame.length, payload)
            except (HubError, ValueError):
                program.refused += 1
        program.until_ns = question.until_ns
        if question.until_ns == LEAVE:
            program.connection.close()
            self._hub.close_port(program.port)
            self._programs.remove(program)

    def _go_on(self) -> bool:
        """Advance to the first instant at which a program continues; True if there is none."""
        while not any(self._ready(program) for program in self._programs):
            limit = min(p.until_ns for p in self._programs if p.until_ns is not None)
            if not self._hub.step(limit):
                return True
            self._show()
        return False

    def _ready(self, program: _Program) -> bool:
        assert program.until_ns is not None
        return bool(program.port.entries) or program.until_ns <= self._hub.now_ns()

    def _answer(self, *, over: bool) -> None:
        for program in self._programs:
            if not over and not self._ready(program):
                continue
            answer = Reply(
                self._hub.now_ns(),
                program.refused,
                over,
                self._hub.node_state(program.port)[0] == BUS_OFF,
                list(program.port.entries),
            )
            program.port.entries.clear()
            program.until_ns, program.refused = None, 0
            # one that has gone is found out when it is asked
            with suppress(OSError):
                send_answer(program.connection, answer)

    def _show(self) -> None:
        if self._watching is None or self._mirror is None:
            return
        while self._watching.entries:
            self._mirror(self._watching.entries.popleft())
