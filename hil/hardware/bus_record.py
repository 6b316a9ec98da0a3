"""Record of a real bus, with the interface's time stamps, and its summary.

The record is filled from within a loop, into memory allocated beforehand; it is evaluated after
the run.
"""

import struct
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import can
import numpy as np
from numpy.typing import NDArray

from canroll.hil.hardware import error_frames
from canroll.hil.hardware.interfaces import CLASSIFIED
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, FD, REMOTE, length_of

ERROR, SENT = 64, 128
"""Flags in addition to those of the wire: an error frame, and a frame that we sent."""
ENTRY: Final = np.dtype(
    [
        ("read_ns", "i8"),
        ("stamp_ns", "i8"),
        ("ident", "u4"),
        ("flags", "u1"),
        ("length", "u1"),
        ("_", "u2"),
        ("payload", "u1", (8,)),
    ]
)
"""One frame: when it was read or sent by the monotonic clock, the interface's stamp (ns, 0: none),
flags, and the first 8 bytes."""
ROOM = 1 << 18
"""Frames that are kept: four minutes of a bus with a thousand a second."""
STEP_NS = 1_000_000
"""Change beyond which the wall clock was set during the run, so that stamps are meaningless."""

_ENTRY = struct.Struct("<qqIBBxx8s")


@dataclass(frozen=True, slots=True)
class RecordOrigin:
    """Origin of a record.

    Attributes:
        interface: python-can's name and channel.
        clock: clock of the time stamps.
        comparable: whether it can be compared with this machine's clock.
        bitrate: bit rate of the bus, bit/s; None: unknown.
        classified: error frames carry SocketCAN's error classes.
    """

    interface: str
    clock: str
    comparable: bool
    bitrate: int | None
    classified: bool


def source(name: str, channel: str, clock: tuple[str, bool], bitrate: int | None) -> RecordOrigin:
    """Return the description of an interface as a source."""
    return RecordOrigin(f"{name} {channel}".strip(), *clock, bitrate, name in CLASSIFIED)


class BusRecord:
    """Memory for ``room`` frames; recording ends when it is full."""

    def __init__(self, source: RecordOrigin, room: int = ROOM) -> None:
        self.source = source
        self._memory = bytearray(_ENTRY.size * room)
        self._end = 0
        self.full = False
        self.offset_ns = wall_minus_monotonic()

    def heard(self, message: can.Message) -> None:
        """Record a received frame."""
        flags = (
            EXTENDED * message.is_extended_id
            | REMOTE * message.is_remote_frame
            | ERROR * message.is_error_frame
            | FD * message.is_fd
        )
        stamp = round(message.timestamp * 1e9)
        self._note(stamp, message.arbitration_id, flags, message.dlc, bytes(message.data))

    def sent(self, ident: int, payload: bytes, *, extended: bool) -> None:
        """Record a sent frame."""
        self._note(0, ident, SENT | EXTENDED * extended, len(payload), payload)

    def _note(self, stamp: int, ident: int, flags: int, length: int, payload: bytes) -> None:
        if self._end == len(self._memory):
            self.full = True
            return
        now = time.monotonic_ns()
        _ENTRY.pack_into(self._memory, self._end, now, stamp, ident, flags, length, payload)
        self._end += _ENTRY.size

    def entries(self) -> NDArray[np.void]:
        """Return the recorded entries (:data:`ENTRY`)."""
        return np.frombuffer(bytes(self._memory[: self._end]), ENTRY)

    def about(self) -> dict[str, Any]:
        """Return the further inputs of :func:`summary`, as plain data."""
        return {
            "interface": self.source.interface,
            "clock": self.source.clock,
            "comparable": self.source.comparable,
            "bitrate": self.source.bitrate,
            "classified": self.source.classified,
            "offsets_ns": [self.offset_ns, wall_minus_monotonic()],
            "real_time": True,
            "full": self.full,
        }


def wall_minus_monotonic() -> int:
    """Return CLOCK_REALTIME minus the monotonic clock, ns."""
    return time.time_ns() - time.monotonic_ns()


def waits_ns(
    entries: NDArray[np.void], about: Mapping[str, Any]
) -> tuple[NDArray[np.int64], str | None]:
    """Return the time each frame waited at the interface before it was read, ns.

    Also return the reason if there are none, else None.
    """
    none = np.zeros(0, np.int64)
    if not about["real_time"]:
        return none, "in lock step"
    if not about["comparable"]:
        return none, f"the clock is {about['clock']}"
    before, after = about["offsets_ns"]
    if abs(after - before) > STEP_NS:
        return none, "the wall clock was set during the run"
    heard = entries[(entries["flags"] & (SENT | ERROR) == 0) & (entries["stamp_ns"] > 0)]
    if not len(heard):
        return none, "no frame had a time stamp"
    waits: NDArray[np.int64] = heard["read_ns"] + (before + after) // 2 - heard["stamp_ns"]
    return waits, None


def errors(entries: NDArray[np.void], about: Mapping[str, Any]) -> dict[str, int]:
    """Return the number of reports of each kind of error."""
    frames = [(int(e["ident"]), _data(e)) for e in entries[entries["flags"] & ERROR != 0]]
    return error_frames.count(frames, classified=about["classified"])


def bits(entries: NDArray[np.void]) -> int | None:
    """Return the number of bits of all frames on the wire, spaces included; None with FD frames.

    FD frames are not recorded with their whole payload. Error flags and retransmissions are not
    counted.
    """
    frames = entries[entries["flags"] & ERROR == 0]
    if np.any(frames["flags"] & FD):
        return None
    wire = EXTENDED | REMOTE
    return sum(
        length_of(int(e["ident"]), _data(e), int(e["flags"]) & wire, length=int(e["length"]))[0]
        for e in frames
    )


def load(entries: NDArray[np.void], about: Mapping[str, Any]) -> tuple[float | None, str | None]:
    """Return the bus load of its frames, or None and the reason why it is unknown."""
    if not about["real_time"]:
        return None, "in lock step"
    if not about["bitrate"]:
        return None, "without -b"
    total = bits(entries)
    if total is None:
        return None, "with FD frames"
    if len(entries) < 2 or entries["read_ns"][-1] <= entries["read_ns"][0]:
        return None, "of so few frames"
    span = float(entries["read_ns"][-1] - entries["read_ns"][0]) * 1e-9
    return total / (about["bitrate"] * span), None


def summary(entries: NDArray[np.void], about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the summary of a record, as plain data."""
    wrong = entries["flags"] & ERROR != 0
    share, unknown = load(entries, about)
    return {
        "interface": about["interface"],
        "frames": int(np.sum(~wrong)),
        "bitrate": about["bitrate"],
        "load": share,
        "load_missing": unknown,
        "error_frames": int(np.sum(wrong)),
        "errors": errors(entries, about),
        "clock": about["clock"],
        "full": about["full"],
    }


def _data(entry: np.void) -> bytes:
    if entry["flags"] & REMOTE:
        return b""
    return bytes(entry["payload"][: min(int(entry["length"]), 8)])


def about_of(record: BusRecord | None) -> dict[str, Any] | None:
    """Return :meth:`BusRecord.about`, or None without a record."""
    return None if record is None else record.about()


def entries_of(record: BusRecord | None) -> NDArray[np.void]:
    """Return :meth:`BusRecord.entries`, empty without a record."""
    return np.zeros(0, ENTRY) if record is None else record.entries()
