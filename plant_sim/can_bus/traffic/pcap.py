"""Bus logs for Wireshark and tcpdump: .pcap and .pcapng with the link type of SocketCAN.

Plug-ins of python-can, selected by ``can.Logger`` and ``can.LogReader`` from the suffix. Times are
written in nanoseconds. A .pcap has one channel and no direction; a .pcapng has one interface per
channel, named ``can0`` and so on, and the direction of every frame.
Sources: LINKTYPE_CAN_SOCKETCAN of tcpdump.org, draft-ietf-opsawg-pcap, draft-ietf-opsawg-pcapng.
"""

from collections.abc import Iterator
from struct import Struct, error, unpack_from
from typing import Any, BinaryIO, Final

import can
from can.io.generic import BinaryIOMessageReader, BinaryIOMessageWriter
from can.typechecking import StringPathLike
from can.util import channel2int

from canroll.errors import CanrollError

LINK_TYPE: Final = 227
_FRAME: Final = Struct(">IBBH")
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_BRS, _ESI, _FDF = 1, 2, 4
_BUS_ERROR: Final = 0x88
"""Class of an error frame (linux/can/error.h): protocol violation, bus error."""
_CLASSIC, _FD = 16, 72
"""Bytes of a packet, padding included, as SocketCAN has them."""
_SNAP: Final = 0x40000
_NS: Final = 0xA1B23C4D
_US: Final = 0xA1B2C3D4
_SECTION, _INTERFACE, _PACKET = 0x0A0D0D0A, 1, 6
_ORDER: Final = 0x1A2B3C4D
_NAME, _RESOLUTION, _FLAGS = 2, 9, 2
"""Options: of an interface its name and time resolution, of a packet its flags."""
_RECEIVED, _SENT = 1, 2


def packet(message: can.Message) -> bytes:
    """Return a frame as the packet of ``LINK_TYPE``."""
    ident = message.arbitration_id
    ident |= _EXTENDED if message.is_extended_id and not message.is_error_frame else 0
    ident |= _REMOTE if message.is_remote_frame else 0
    data = bytes(message.data or b"")
    length = message.dlc
    if message.is_error_frame:
        ident, data, length = _ERROR | _BUS_ERROR, bytes(8), 8
    flags = 0
    if message.is_fd:
        flags = _FDF | (_BRS if message.bitrate_switch else 0)
        flags |= _ESI if message.error_state_indicator else 0
    size = _FD if message.is_fd else _CLASSIC
    return (_FRAME.pack(ident, length, flags, 0) + data).ljust(size, b"\0")


def message_of(data: bytes, time_s: float, channel: int | str, *, is_rx: bool) -> can.Message:
    """Return the frame of a packet of ``LINK_TYPE``."""
    ident, length, flags, _ = _FRAME.unpack_from(data)
    fd = bool(flags & _FDF) or len(data) == _FD
    remote, broken = bool(ident & _REMOTE), bool(ident & _ERROR)
    payload = data[_FRAME.size : _FRAME.size + length]
    return can.Message(
        timestamp=time_s,
        arbitration_id=0 if broken else ident & 0x1FFF_FFFF,
        is_extended_id=bool(ident & _EXTENDED),
        is_remote_frame=remote,
        is_error_frame=broken,
        is_fd=fd,
        bitrate_switch=fd and bool(flags & _BRS),
        error_state_indicator=fd and bool(flags & _ESI),
        is_rx=is_rx,
        channel=channel,
        dlc=0 if broken else length,
        data=None if remote or broken else payload,
    )


class PcapWriter(BinaryIOMessageWriter):
    """Writes a .pcap.

    Raises:
        CanrollError: a message has a different channel than the previous ones.
    """

    def __init__(self, file: StringPathLike | BinaryIO, **options: Any) -> None:  # noqa: ANN401
        super().__init__(file, **options)
        self._channel: Any = None
        self.file.write(Struct("<IHHiIII").pack(_NS, 2, 4, 0, 0, _SNAP, LINK_TYPE))

    def on_message_received(self, msg: can.Message) -> None:
        """Append a message."""
        if self._channel is None:
            self._channel = msg.channel
        if msg.channel != self._channel:
            raise CanrollError(
                f"a .pcap has one channel, and there are frames of {self._channel} and"
                f" {msg.channel}: write a .pcapng"
            )
        data = packet(msg)
        seconds, nanoseconds = divmod(round(msg.timestamp * 1e9), 10**9)
        self.file.write(Struct("<IIII").pack(seconds, nanoseconds, len(data), len(data)) + data)


class PcapngWriter(BinaryIOMessageWriter):
    """Writes a .pcapng."""

    def __init__(self, file: StringPathLike | BinaryIO, **options: Any) -> None:  # noqa: ANN401
        super().__init__(file, **options)
        self._channels: dict[Any, int] = {}
        self._block(_SECTION, Struct("<IHHq").pack(_ORDER, 1, 0, -1))

    def on_message_received(self, msg: can.Message) -> None:
        """Append a message, and its channel if it is new."""
        if msg.channel not in self._channels:
            self._channels[msg.channel] = len(self._channels)
            number = channel2int(msg.channel)
            name = str(msg.channel) if number is None else f"can{number}"
            options = _options_of({_NAME: name.encode(), _RESOLUTION: b"\x09"})
            self._block(_INTERFACE, Struct("<HHI").pack(LINK_TYPE, 0, _SNAP) + options)
        data = packet(msg)
        high, low = divmod(round(msg.timestamp * 1e9), 1 << 32)
        head = self._channels[msg.channel], high, low, len(data), len(data)
        options = _options_of({_FLAGS: Struct("<I").pack(_RECEIVED if msg.is_rx else _SENT)})
        self._block(_PACKET, Struct("<IIIII").pack(*head) + data + options)

    def _block(self, kind: int, body: bytes) -> None:
        size = Struct("<I").pack(len(body) + 12)
        self.file.write(Struct("<I").pack(kind) + size + body + size)


def _options_of(values: dict[int, bytes]) -> bytes:
    """Return options, each padded to 32 bits, and their end."""
    head = Struct("<HH")
    options = (head.pack(k, len(v)) + v + bytes(-len(v) % 4) for k, v in values.items())
    return b"".join(options) + head.pack(0, 0)


class CaptureReader(BinaryIOMessageReader):
    """Reads the SocketCAN packets of a .pcap or .pcapng of any byte order and resolution.

    Raises:
        CanrollError: the file is not a capture, is truncated, or has another link type.
    """

    def __init__(self, file: StringPathLike | BinaryIO, **options: Any) -> None:  # noqa: ANN401
        super().__init__(file, **options)

    def __iter__(self) -> Iterator[can.Message]:
        data = self.file.read()
        magic = data[:4]
        try:
            if magic == _SECTION.to_bytes(4, "big"):
                yield from _pcapng(data)
            else:
                yield from _pcap(data)
        except (error, IndexError) as broken:
            raise CanrollError("truncated within a frame") from broken


def _check_link_type(link_type: int) -> None:
    if link_type != LINK_TYPE:
        raise CanrollError(
            f"a capture of link type {link_type}: only {LINK_TYPE} (SocketCAN) is supported"
        )


def _pcap(data: bytes) -> Iterator[can.Message]:
    orders = {
        Struct(f"{sign}I").pack(magic): (sign, unit)
        for magic, unit in ((_NS, 1e-9), (_US, 1e-6))
        for sign in "<>"
    }
    if data[:4] not in orders:
        raise CanrollError("neither a .pcap nor a .pcapng")
    sign, unit = orders[data[:4]]
    _check_link_type(unpack_from(f"{sign}I", data, 20)[0] & 0xFFFF)
    place = 24
    while place < len(data):
        seconds, fraction, size, _ = unpack_from(f"{sign}IIII", data, place)
        place += 16
        yield message_of(_slice(data, place, size), seconds + fraction * unit, "can0", is_rx=True)
        place += size


def _slice(data: bytes, place: int, size: int) -> bytes:
    if place + size > len(data):
        raise IndexError
    return data[place : place + size]


def _pcapng(data: bytes) -> Iterator[can.Message]:
    sign, place = "<", 0
    interfaces: list[tuple[str, float]] = []
    while place < len(data):
        (kind,) = unpack_from(f"{sign}I", data, place)
        if kind == _SECTION:
            # its byte order is its own, and so are the numbers of its interfaces
            little = _slice(data, place + 8, 4) == _ORDER.to_bytes(4, "little")
            sign, interfaces = "<" if little else ">", []
        (size,) = unpack_from(f"{sign}I", data, place + 4)
        body = _slice(data, place + 8, max(size, 12) - 12)
        if kind == _INTERFACE:
            _check_link_type(unpack_from(f"{sign}H", body)[0])
            options = dict(_options(body, 8, sign))
            name = options.get(_NAME, b"").decode(errors="replace") or f"can{len(interfaces)}"
            interfaces.append((name, _unit(options.get(_RESOLUTION, b"\x06")[0])))
        elif kind == _PACKET:
            number, high, low, length, _ = unpack_from(f"{sign}IIIII", body)
            name, unit = interfaces[number]
            flags = dict(_options(body, 20 + length + -length % 4, sign)).get(_FLAGS, bytes(4))
            sent = unpack_from(f"{sign}I", flags)[0] & 3 == _SENT
            time_s = (high << 32 | low) * unit
            yield message_of(_slice(body, 20, length), time_s, name, is_rx=not sent)
        place += max(size, 12)


def _options(body: bytes, place: int, sign: str) -> Iterator[tuple[int, bytes]]:
    while place + 4 <= len(body):
        code, length = unpack_from(f"{sign}HH", body, place)
        if code == 0:
            return
        yield code, body[place + 4 : place + 4 + length]
        place += 4 + length + -length % 4


def _unit(resolution: int) -> float:
    """Return the unit of time of an interface in seconds: a power of 10, or of 2."""
    base: float = 2.0 if resolution & 0x80 else 10.0
    return float(base ** -(resolution & 0x7F))
