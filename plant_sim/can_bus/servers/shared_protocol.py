"""TCP protocol between a shared bus and its programs.

A program joins with one line of JSON. Each of its questions then contains the frames it has sent
since the last one and the time until which it waits; the bus answers with the time and the frames
received.
"""

import json
import socket
from struct import Struct
from typing import Any, Final, NamedTuple

from plant_sim.can_bus.servers.hub import PortFrame

_ASK: Final = Struct("<qI")
_SENT: Final = Struct("<IHB64s")
_ANSWER: Final = Struct("<qIIBB")
_CAME: Final = Struct("<dIHBBh64s")
LEAVE: Final = -1
"""Time in the question of a program that leaves."""
MAX_FRAMES: Final = 1 << 16
MAX_LINE: Final = 1000


class Sent(NamedTuple):
    """A frame that a program sends."""

    ident: int
    flags: int
    length: int
    payload: bytes


class Question(NamedTuple):
    """Wait until ``until_ns`` after sending ``frames``; ``LEAVE``: the program leaves."""

    until_ns: int
    frames: list[Sent]


class Reply(NamedTuple):
    """The time ``now_ns`` and the received ``frames``; ``refused``: number of frames without room.

    ``over``: no event is left on the bus. ``bus_off``: the node is bus-off.
    """

    now_ns: int
    refused: int
    over: bool
    bus_off: bool
    frames: list[PortFrame]


def send_line(connection: socket.socket, content: dict[str, Any]) -> None:
    """Send one JSON object."""
    connection.sendall(json.dumps(content).encode() + b"\n")


def read_line(connection: socket.socket) -> dict[str, Any]:
    """Receive one JSON object.

    Raises:
        ConnectionError: the connection is lost, or the line is not a JSON object.
    """
    line = b""
    while not line.endswith(b"\n"):
        byte = connection.recv(1)
        if not byte or len(line) > MAX_LINE:
            raise ConnectionError("no answer")
        line += byte
    return parse_line(line)


def parse_line(line: bytes) -> dict[str, Any]:
    """Return the JSON object of a line.

    Raises:
        ConnectionError: it is none.
    """
    try:
        content = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise ConnectionError("not a program of a shared bus") from error
    if not isinstance(content, dict):
        raise ConnectionError("not a program of a shared bus")
    return content


def send_question(connection: socket.socket, question: Question) -> None:
    """Send a question."""
    parts = [_ASK.pack(question.until_ns, len(question.frames))]
    parts += [_SENT.pack(f.ident, f.flags, f.length, f.payload) for f in question.frames]
    connection.sendall(b"".join(parts))


def read_question(connection: socket.socket) -> Question:
    """Receive a question.

    Raises:
        ConnectionError: the connection is lost.
    """
    until_ns, count = _ASK.unpack(_exactly(connection, _ASK.size))
    data = _exactly(connection, _counted(count) * _SENT.size)
    return Question(until_ns, [Sent(*fields) for fields in _SENT.iter_unpack(data)])


def send_answer(connection: socket.socket, answer: Reply) -> None:
    """Send an answer."""
    count = len(answer.frames)
    parts = [_ANSWER.pack(answer.now_ns, count, answer.refused, answer.over, answer.bus_off)]
    parts += [
        _CAME.pack(f.time_s, f.ident, f.flags, f.length, f.error, f.sender, f.payload)
        for f in answer.frames
    ]
    connection.sendall(b"".join(parts))


def read_answer(connection: socket.socket) -> Reply:
    """Receive an answer.

    Raises:
        ConnectionError: the connection is lost.
    """
    now_ns, count, refused, over, bus_off = _ANSWER.unpack(_exactly(connection, _ANSWER.size))
    frames = []
    data = _exactly(connection, _counted(count) * _CAME.size)
    for time_s, ident, flags, length, error, sender, payload in _CAME.iter_unpack(data):
        frames.append(
            PortFrame(time_s, ident, flags, payload[:length], length, bool(error), sender)
        )
    return Reply(now_ns, refused, bool(over), bool(bus_off), frames)


def _counted(count: int) -> int:
    if count > MAX_FRAMES:
        raise ConnectionError("not a program of a shared bus")
    return count


def _exactly(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = connection.recv(count - len(data))
        if not part:
            raise ConnectionError("the other side has gone")
        data += part
    return data
