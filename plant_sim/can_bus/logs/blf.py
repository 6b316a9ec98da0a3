"""Binary logs of Vector (``.blf``) through python-can's reader, held against their own objects.

python-can's reader passes over two kinds of error frames, over objects outside of containers, and
over the end of a file that was cut off; so the objects are walked here too, and counted, and it
gets them in one container, with those error frames as the kind that it reads.
Source of the layout: python-can's ``blf.py``, after Vector_BLF.
"""

import io
import zlib
from collections.abc import Iterator
from struct import Struct, error
from typing import Final

import can
from can.io import blf

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.logs.lines import Numbered, reader_warnings
from canroll.plant_sim.can_bus.logs.remarks import Remarks

_FRAMES: Final = (
    *(blf.CAN_MESSAGE, blf.CAN_MESSAGE2, blf.CAN_ERROR_EXT),
    *(blf.CAN_FD_MESSAGE, blf.CAN_FD_MESSAGE_64),
)
"""Kinds of objects that python-can reads."""
_FILE: Final = b"LOGG"
_SIGNATURE: Final = b"LOBJ"
_PADDING: Final = 8
"""Within so many bytes behind an object the next one begins."""
_ERRORS: Final = {2: Struct("<H"), 104: Struct("<B")}
"""Kinds of error frames that it does not read; both begin with the channel."""
_COUNT_PLACE: Final = Struct("<32xL")
DAMAGED: Final = "damaged, or not a BLF"


def read(content: bytes, remarks: Remarks) -> list[Numbered]:
    """Return the frames of a log.

    Raises:
        CanrollError: it is no BLF, or damaged before its end.
    """
    kinds: list[int] = []
    messages: list[can.Message] = []
    walk = _Walk(content)
    try:
        for kind in walk.kinds():
            kinds.append(kind)
        reader = blf.BLFReader(io.BytesIO(walk.in_one_container()))
        # of versions that it does not know it warns, object by object: they are counted below
        with reader_warnings():
            for message in reader:
                messages.append(message)
    except (error, ValueError, zlib.error, blf.BLFParseError, OverflowError) as fault:
        if not walk.cut:
            place = f": what is behind its object {len(kinds)}" if kinds else ""
            raise CanrollError(f"{DAMAGED}{place}") from fault
    stated = _COUNT_PLACE.unpack_from(content)[0]
    if walk.cut:
        remarks.add("the file is cut off: its last frames are missing")
    elif len(kinds) < stated:
        remarks.add(f"the header counts {stated} objects, {len(kinds)} are there")
    there = sum(kind in (*_FRAMES, *_ERRORS) for kind in kinds)
    if len(messages) != there:
        remarks.add(f"{there} frames are there, {len(messages)} can be read")
    return [Numbered(number, message) for number, message in enumerate(messages, 1)]


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

    def kinds(self) -> Iterator[int]:
        """Yield the kinds of the objects, within containers or not, in their order."""
        buffer = b""
        for piece in self._pieces():
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
                self._read.append(_readable(buffer[start:end], kind))
                yield kind
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


def _readable(data: bytes, kind: int) -> bytes:
    """Return an object, an error frame that python-can does not read as one that it does."""
    if kind not in _ERRORS:
        return data
    base = blf.OBJ_HEADER_BASE_STRUCT
    _, header_size, version, _, _ = base.unpack_from(data)
    (channel,) = _ERRORS[kind].unpack_from(data, header_size)
    body = data[base.size : header_size] + blf.CAN_ERROR_EXT_STRUCT.pack(channel, *(0,) * 8, b"")
    return (
        base.pack(_SIGNATURE, header_size, version, base.size + len(body), blf.CAN_ERROR_EXT) + body
    )
