"""python-can interface ``simbus_shared``: a node on a bus that several programs share in lock step.

``can.Bus("127.0.0.1:29600", interface="simbus_shared", node="ecu")`` joins the bus that
``canroll bus SET --share --programs N`` serves. ``node``: a unique name for each program, which
decides the order of frames queued at one instant. ``token``: what a bus that other machines can
reach shows as it starts. ``fd=True``: it sends and receives FD frames;
``receive_own_messages`` as in python-can.

Time passes only in ``recv`` with a timeout and in ``let_pass``: the bus advances when all programs
are in one of them. A program that sleeps or computes delays the others without affecting the
result.
"""

import socket
import time
from collections import deque
from typing import Any, Final

import can

from plant_sim.can_bus.servers.frames import message_of, sent_flags, truth
from plant_sim.can_bus.servers.hub import TRANSMIT_QUEUE, PortFrame
from plant_sim.can_bus.servers.shared_protocol import (
    LEAVE,
    Question,
    Reply,
    Sent,
    read_answer,
    read_line,
    send_line,
    send_question,
)
from plant_sim.kernels.instants import NEVER

_RETRY_S: Final = 0.1


class SharedSimBus(can.BusABC):
    """Node of one program; see the module docstring.

    Args:
        channel: HOST:PORT of the server.
        node: name of this program on the bus.
        token: of the bus; "": it has none.
        fd: it sends and receives FD frames.
        receive_own_messages: it also receives its own frames.
        join_timeout: longest wait for the server and the other programs, s; None: no limit.
        can_filters: as of python-can.
        **kwargs: further options of python-can.

    Raises:
        can.CanInitializationError: no server, or another program has that name.
    """

    def __init__(
        self,
        channel: str = "127.0.0.1:29600",
        *,
        node: str = "node",
        token: str = "",
        fd: bool | str = False,
        receive_own_messages: bool | str = False,
        join_timeout: float | None = 60.0,
        can_filters: Any = None,  # noqa: ANN401
        **kwargs: Any,  # noqa: ANN401
    ) -> None:
        self._connection: socket.socket | None = None
        self._fd = truth(fd)
        self._waiting: list[Sent] = []
        self._entries: deque[PortFrame] = deque()
        self._now_ns = 0
        self.channel = channel
        self._connection = _join(
            str(channel),
            {
                **{"name": str(node), "token": str(token), "fd": self._fd},
                "receive_own": truth(receive_own_messages),
            },
            None if join_timeout is None else float(join_timeout),
        )
        try:
            answer = read_line(self._connection)
        except OSError as error:
            raise can.CanInitializationError(
                f"simbus_shared {channel}: not all programs have joined: {error}"
            ) from error
        if "error" in answer:
            raise can.CanInitializationError(f"simbus_shared {channel}: {answer['error']}")
        self._node = int(answer["node"])
        self._connection.settimeout(None)
        self.channel_info = f"simbus_shared {channel}, node '{node}'"
        self._can_protocol = can.CanProtocol.CAN_FD if self._fd else can.CanProtocol.CAN_20
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)

    @property
    def now(self) -> float:
        """The time of the bus, s."""
        return self._now_ns * 1e-9

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue ``msg`` at the present time of the bus.

        Args:
            msg: the frame.
            timeout: ignored, as no time passes here; a full queue is reported by the next call that
                waits.

        Raises:
            can.CanOperationError: the frame is invalid, or FD without ``fd``; the connection is
            lost.
        """
        self._waiting.append(
            Sent(
                msg.arbitration_id,
                sent_flags(msg, fd=self._fd, where=self.channel_info),
                msg.dlc,
                b"" if msg.is_remote_frame else bytes(msg.data),
            )
        )
        if len(self._waiting) >= TRANSMIT_QUEUE // 2:
            self._wait(self._now_ns)

    def let_pass(self, duration_s: float) -> None:
        """Wait for a duration of bus time; frames received meanwhile are kept for ``recv``."""
        end = self._now_ns + round(max(0.0, duration_s) * 1e9)
        while self._wait(end) is not None and self._now_ns < end:
            pass

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, None after ``timeout`` seconds of the bus.

        Returns None at once if no event is left on the bus.
        """
        end = NEVER if timeout is None else self._now_ns + round(max(0.0, timeout) * 1e9)
        while True:
            while self._entries:
                message = message_of(self._entries.popleft(), self.channel, self._node)
                if self._matches_filters(message):
                    return message
            if self._wait(end) is None or (not self._entries and self._now_ns >= end):
                return None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self.recv(timeout), True

    def _wait(self, until_ns: int) -> Reply | None:
        """Send the pending frames and wait; None if no event is left on the bus."""
        if self._connection is None:
            raise can.CanOperationError("the bus has been shut down")
        frames, self._waiting = self._waiting, []
        try:
            send_question(self._connection, Question(until_ns, frames))
            answer = read_answer(self._connection)
        except OSError as error:
            raise can.CanOperationError(f"{self.channel_info}: {error}") from error
        self._now_ns = answer.now_ns
        self._entries.extend(answer.frames)
        if answer.bus_off:
            raise can.CanOperationError(f"{self.channel_info}: the node is bus-off")
        if answer.refused:
            raise can.CanOperationError(
                f"{self.channel_info}: transmit queue full, {answer.refused} frames lost"
            )
        return None if answer.over else answer

    def shutdown(self) -> None:
        """Leave the bus; frames already sent stay queued."""
        super().shutdown()
        if self._connection is not None:
            frames, self._waiting = self._waiting, []
            try:
                send_question(self._connection, Question(LEAVE, frames))
            except OSError:
                pass
            finally:
                self._connection.close()
                self._connection = None


def _join(channel: str, request: dict[str, Any], timeout: float | None) -> socket.socket:
    """Connect to the server, which may still be starting, and join."""
    host, _, port = channel.rpartition(":")
    if not host or not port.isdigit():
        raise can.CanInitializationError(f"simbus_shared: channel '{channel}': HOST:PORT expected")
    end = None if timeout is None else time.monotonic() + timeout
    while True:
        try:
            connection = socket.create_connection((host, int(port)), timeout)
        except (OSError, OverflowError) as error:
            if end is not None and time.monotonic() > end:
                raise can.CanInitializationError(f"simbus_shared {channel}: {error}") from error
            time.sleep(_RETRY_S)
            continue
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        send_line(connection, request)
        return connection
