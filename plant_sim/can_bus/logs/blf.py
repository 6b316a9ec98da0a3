"""Binary logs of Vector (``.blf``) through python-can's reader, held against their own objects.

python-can's reader passes over two kinds of error frames, over objects outside of containers, and
over the end of a file that was cut off; so the objects are walked here too, and counted, and it
gets them in one container.
Source of the layout: python-can's ``blf.py``, after Vector_BLF.
"""

import io
import zlib
from collections.abc import Iterator
from itertools import islice
from struct import Struct, error
from typing import Final, NamedTuple

import can
from can.io import blf

from canroll.errors import CanrollError
from plant_sim.can_bus.logs.lines import Numbered, reader_warnings
from plant_sim.can_bus.logs.remarks import Remarks

_FRAMES: Final = (
    *(blf.CAN_MESSAGE, blf.CAN_MESSAGE2, blf.CAN_ERROR_EXT),
    *(blf.CAN_FD_MESSAGE, blf.CAN_FD_MESSAGE_64),
)
"""Kinds of objects that python-can reads."""
_ERROR, _FD_ERROR_64 = 2, 104
"""Error frames that it does not read; both begin with the channel."""
_FILE: Final = b"LOGG"
_SIGNATURE: Final = b"LOBJ"
_PADDING: Final = 8
"""Within so many bytes behind an object the next one begins."""
_CHANNELS: Final = {_ERROR: Struct("<H"), _FD_ERROR_64: Struct("<B")}
_COUNT_PLACE: Final = Struct("<32xL")
DAMAGED: Final = "damaged, or not a BLF"


class _Object(NamedTuple):
    """An object; time and channel only of error frames that python-can does not read."""

    kind: int
    time_s: float = 0.0
    channel: int = 0


def read(content: bytes, remarks: Remarks) -> list[Numbered]:
    """Return the frames of a log.

    Raises:
        CanrollError: it is no BLF, or damaged before its end.
    """
    objects: list[_Object] = []
    messages: list[can.Message] = []
    walk = _Walk(content)
    try:
        for item in walk.objects():
            objects.append(item)
        reader = blf.BLFReader(io.BytesIO(walk.in_one_container()))
        # of versions that it does not know it warns, object by object: they are counted below
        with reader_warnings():
            for message in reader:
                messages.append(message)
    except (error, ValueError, zlib.error, blf.BLFParseError, OverflowError) as fault:
        if not walk.cut:
            place = f": what is behind its object {len(objects)}" if objects else ""
            raise CanrollError(f"{DAMAGED}{place}") from fault
    frames = iter(messages)
    entries: list[Numbered] = []
    for item in objects:
        if item.kind in _FRAMES:
            entries += [Numbered(len(entries) + 1, message) for message in islice(frames, 1)]
        elif item.kind in _CHANNELS:
            broken = can.Message(
                timestamp=item.time_s + reader.start_timestamp,
                is_error_frame=True,
                channel=item.channel - 1,
            )
            entries.append(Numbered(len(entries) + 1, broken))
    stated = _COUNT_PLACE.unpack_from(content)[0]
    if walk.cut:
        remarks.add("the file is cut off: its last frames are missing")
    elif len(objects) < stated:
        remarks.add(f"the header counts {stated} objects, {len(objects)} are there")
    there = sum(item.kind in _FRAMES for item in objects)
    if len(messages) != there:
        remarks.add(f"{there} frames are there, {len(messages)} can be read")
    return entries


class _Walk:
    """A walk over the objects of a file; ``cut``: it ends within one."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._read: list[bytes] = []
        self.cut = False

    def in_one_container(self) -> bytes:
        """Return the file with all the objects that were walked in one container."""
        inner, head = b"".join(self._read), blf.OBJ_HEADER_BASE_STRUCT
        box = blf.LOG_CONTAINER_STRUCT.pack(blf.NO_COMPRESSION, len(inner)) + inner
        size = head.size + len(box)
        start = blf.FILE_HEADER_STRUCT.unpack_from(self._content)[1]
        container = head.pack(_SIGNATURE, head.size, 1, size, blf.LOG_CONTAINER) + box
        return self._content[:start] + container + bytes(size % 4)

    def objects(self) -> Iterator[_Object]:
        """Yield the objects, within containers or not, in their order."""
        buffer = b""
        for piece in self._pieces():
            self._read.append(piece)
            buffer += piece
            place = 0
            while (start := buffer.find(_SIGNATURE, place, place + _PADDING)) >= 0:
                if start + blf.OBJ_HEADER_BASE_STRUCT.size > len(buffer):
                    break
                size, kind = blf.OBJ_HEADER_BASE_STRUCT.unpack_from(buffer, start)[3:]
                end = start + size
                if end > len(buffer):
                    break
                if size < blf.OBJ_HEADER_BASE_STRUCT.size:
                    raise ValueError
                yield _object(buffer, start, kind)
                place = end
            if start < 0 and place + _PADDING <= len(buffer):
                raise ValueError
            buffer = buffer[place:]
        self.cut = self.cut or _SIGNATURE in buffer

    def _pieces(self) -> Iterator[bytes]:
        """Yield the contents of the containers, and objects outside of them."""
        content = self._content
        kind, place = blf.FILE_HEADER_STRUCT.unpack_from(content)[:2]
        if kind != _FILE:
            raise ValueError
        head = blf.OBJ_HEADER_BASE_STRUCT
        self.cut = place > len(content)
        while place < len(content):
            if place + head.size > len(content):
                self.cut = self.cut or bool(content[place:].strip(b"\0"))
                return
            signature, _, _, size, kind = head.unpack_from(content, place)
            if signature != _SIGNATURE or size < head.size:
                raise ValueError
            self.cut = place + size > len(content)
            body = content[place + head.size : place + size]
            if kind == blf.LOG_CONTAINER:
                method = blf.LOG_CONTAINER_STRUCT.unpack_from(body)[0]
                inner = body[blf.LOG_CONTAINER_STRUCT.size :]
                yield (
                    inner
                    if method == blf.NO_COMPRESSION
                    else zlib.decompressobj().decompress(inner)
                )
            else:
                yield content[place : place + size + size % 4]
            place += size + size % 4


def _object(buffer: bytes, start: int, kind: int) -> _Object:
    if kind not in _CHANNELS:
        return _Object(kind)
    header_size, version = blf.OBJ_HEADER_BASE_STRUCT.unpack_from(buffer, start)[1:3]
    head = blf.OBJ_HEADER_V1_STRUCT if version == 1 else blf.OBJ_HEADER_V2_STRUCT
    flags, _, _, time = head.unpack_from(buffer, start + blf.OBJ_HEADER_BASE_STRUCT.size)
    unit = 1e-5 if flags == blf.TIME_TEN_MICS else 1e-9
    (channel,) = _CHANNELS[kind].unpack_from(buffer, start + header_size)
    return _Object(kind, time * unit, channel)
