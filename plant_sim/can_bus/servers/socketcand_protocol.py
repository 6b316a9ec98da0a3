"""The words of the socketcand protocol: frames as its clients write and read them."""

from typing import NamedTuple

from plant_sim.can_bus.wire.frame import EXTENDED, REMOTE


class Received(NamedTuple):
    """A frame that a client sent; ``client`` is its place, 0 to ``MAX_CLIENTS − 1``."""

    client: int
    ident: int
    flags: int
    length: int
    payload: bytes


class ProtocolError(Exception):
    """A client said something that is not in the protocol."""


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
    fits = 0 <= ident < (1 << 29 if flags & EXTENDED else 1 << 11) and 0 <= length <= 8
    if not fits or len(payload) != (0 if remote else length):
        raise ProtocolError("no such frame")
    return ident, flags, length, payload


def format_frame(ident: int, flags: int, time_s: float, payload: bytes, length: int) -> bytes:
    """Return a received frame as clients in raw mode read it."""
    name = f"{ident:08X}" if flags & EXTENDED else f"{ident:03X}"
    if flags & REMOTE:
        return f"< rtr {name} {time_s:.6f} {length} >".encode()
    return f"< frame {name} {time_s:.6f} {payload.hex().upper()} >".encode()
