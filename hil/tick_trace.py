"""The trace of an ECU's ticks: all inputs and outputs of the firmware.

Tick number, elapsed ticks and consumed frames determine the loop completely, so a real-time run
can be replayed offline through any backend, with the same frames byte for byte. The tick writes
into memory allocated beforehand, which is moved to a spool when it is full; the file is written
after the run.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.codegen.run.backends import Backend
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.codegen.run.secured import NEW, Lasting
from canroll.codegen.run.services import open_ecu
from canroll.dbc.keys import DEVELOPMENT_KEY
from canroll.errors import UNREADABLE, CanrollError, reason, writing
from canroll.firmware.calibration import Calibration
from canroll.firmware.security.secoc_state import RESET_MAX
from canroll.hil.bus_link import Frame
from canroll.hil.hardware.bus_record import ENTRY
from canroll.plant_sim.world import archive
from canroll.plant_sim.world.spool import Rows, Table
from canroll.runs.trace import entries, restored
from canroll.runs.virtual_time import TickRows

TICKS = np.dtype(
    [
        ("number", "i8"),
        ("elapsed", "i4"),
        ("frames", "i4"),
        ("deadline_ns", "i8"),
        ("start_ns", "i8"),
        ("end_ns", "i8"),
    ]
)
"""One tick: its number (skipped ticks counted), periods since the last one, frames in and out, and
its instants on the system's monotonic clock."""
_TICK = struct.Struct("<qiiqqq")


def frames_of(room: int) -> np.dtype[Any]:
    """One frame of up to ``room`` bytes: ``sent`` 0 consumed, 1 sent.

    A tick's frames are in order, the consumed ones first.
    """
    return np.dtype(
        [("ident", "u4"), ("sent", "u1"), ("length", "u1"), ("_", "u2"), ("payload", "u1", (room,))]
    )


FRAMES = frames_of(8)
"""Frames of the built-in bus."""


class TickRecorder:
    """Memory for ``ticks`` ticks and ``frames`` frames, moved to a spool whenever it is full.

    A tick that fills it moves it after its end, so that what this takes shows as the lateness of
    the next one. Where the spool cannot be written recording ends, and the loop goes on.
    ``room``: bytes of the longest frame.
    """

    def __init__(self, *, ticks: int = 500, frames: int = 10_000, room: int = 8) -> None:
        self._frame_struct = struct.Struct(f"<IBBxx{room}s")
        self._ticks = bytearray(_TICK.size * ticks)
        self._frames = bytearray(self._frame_struct.size * frames)
        self._tick_rows, self._frame_rows = Rows(TICKS), Rows(frames_of(room))
        self._tick_end = self._frame_end = 0
        self._in_tick = 0
        self.full = False

    def consumed(self, ident: int, payload: bytes) -> None:
        """Record a frame consumed by the tick."""
        self._frame(ident, 0, payload)

    def sent(self, ident: int, payload: bytes) -> None:
        """Record a frame sent by the tick."""
        self._frame(ident, 1, payload)

    def tick(self, number: int, elapsed: int, deadline: int, start: int, end: int) -> None:
        """Close a tick: the frames recorded since the last one belong to it."""
        if self.full:
            return
        count = self._in_tick
        _TICK.pack_into(self._ticks, self._tick_end, number, elapsed, count, deadline, start, end)
        self._tick_end += _TICK.size
        self._in_tick = 0
        if self._tick_end == len(self._ticks):
            self._move()

    def _frame(self, ident: int, sent: int, payload: bytes) -> None:
        if self._frame_end == len(self._frames):
            self._move()
        if self.full:
            return
        frame = self._frame_struct
        frame.pack_into(self._frames, self._frame_end, ident, sent, len(payload), payload)
        self._frame_end += frame.size
        self._in_tick += 1

    def _move(self) -> None:
        if self.full:
            return
        try:
            self._frame_rows.append(_rows(self._frames, self._frame_end, self._frame_rows.dtype))
            self._tick_rows.append(_rows(self._ticks, self._tick_end, TICKS))
        except CanrollError:
            self.full = True
            return
        self._tick_end = self._frame_end = 0

    def ticks(self) -> Rows:
        """Return the closed ticks."""
        self._move()
        return self._tick_rows

    def frames(self) -> Rows:
        """Return the frames of the closed ticks."""
        self._move()
        closed = int(self._tick_rows["frames"].sum())
        if len(self._frame_rows) == closed:
            return self._frame_rows
        return Rows.of(self._frame_rows[:closed])


def _rows(memory: bytearray, end: int, kind: np.dtype[Any]) -> NDArray[np.void]:
    return np.frombuffer(bytes(memory[:end]), kind)


@dataclass(frozen=True, slots=True)
class TickTrace:
    """A recorded run: calibration, ticks (:data:`TICKS`), frames (:func:`frames_of`), metadata.

    ``bus``: everything on the real bus (:data:`canroll.hil.hardware.bus_record.ENTRY`).
    """

    calibration: Calibration
    ticks: Table
    frames: Table
    about: Mapping[str, Any]
    bus: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, ENTRY))


def save(path: Path, trace: TickTrace) -> None:
    """Write a trace as a NumPy archive.

    Raises:
        CanrollError: the file cannot be written.
    """
    with writing(path):
        archive.write(path, entries(trace), compressed=True)


def load(path: Path) -> TickTrace:
    """Read a trace.

    Raises:
        CanrollError: the file contains none.
    """
    try:
        with archive.Archive(path) as stored:
            return restored(TickTrace, stored)
    except OSError as error:
        raise CanrollError(f"cannot read {path}: {reason(error)}") from error
    except UNREADABLE as error:
        raise CanrollError(f"{path}: not a tick trace; 'canroll ecu --trace' writes one") from error


@dataclass(frozen=True, slots=True)
class TickReplay:
    """A backend's run of a trace: rows (:data:`canroll.runs.trace.TICK`), first difference."""

    rows: NDArray[np.void]
    difference: str | None


def ecu_of(
    trace: TickTrace,
    backend: str,
    *,
    firmware: BusFirmware | None = None,
    key: bytes = DEVELOPMENT_KEY,
) -> Backend:
    """Start an ECU as that of a trace was: with what it remembered of earlier starts.

    Raises:
        CanrollError: as :func:`canroll.codegen.run.services.open_ecu`; the trace is of another kind
        of bus.
    """
    firmware = firmware or built_in()
    memory = trace.about.get("lasting")
    if (memory is not None) != firmware.bus.secured:
        kind = "without" if memory is None else "with"
        raise CanrollError(f"the trace is of a bus {kind} authenticated frames: choose its --bus")
    lasting = NEW if memory is None else _lasting(memory)
    return open_ecu(backend, trace.calibration, firmware, key=key, lasting=lasting)


def _lasting(memory: Any) -> Lasting:  # noqa: ANN401 - whatever the file has
    try:
        starts, senders = memory
        numbers = [int(starts), *map(int, senders)]
    except UNREADABLE as error:
        raise CanrollError(f"not a tick trace: 'lasting' is {memory!r:.40}") from error
    if not all(0 <= number <= RESET_MAX for number in numbers):
        raise CanrollError(f"not a tick trace: 'lasting' is {memory!r:.40}")
    return Lasting(numbers[0], tuple(numbers[1:]))


def replay(
    trace: TickTrace,
    backend: str,
    *,
    start_ns: int = 0,
    firmware: BusFirmware | None = None,
    key: bytes = DEVELOPMENT_KEY,
    through: Callable[[Backend], Backend] = lambda ecu: ecu,
) -> TickReplay:
    """Replay a trace with ``backend`` and compare every frame sent with the recorded one.

    Args:
        trace: trace of a run from the start of its ECU.
        backend: backend that runs the firmware.
        start_ns: monotonic instant that is time 0 of the rows.
        firmware: firmware for the bus, by default the built-in one.
        key: of the authentication, on a bus whose frames are authenticated.
        through: wraps the ECU, to watch it.
    """
    ecu = through(ecu_of(trace, backend, firmware=firmware, key=key))
    ticks, recorded_frames = np.asarray(trace.ticks), np.asarray(trace.frames)
    rows = TickRows((firmware or built_in()).record)
    difference = None
    first = 0
    for tick in ticks:
        frames = recorded_frames[first : first + int(tick["frames"])]
        first += len(frames)
        answer = _replay_tick(ecu, frames, int(tick["elapsed"]))
        recorded = [_frame(frame) for frame in frames[frames["sent"] == 1]]
        if difference is None and answer != recorded:
            difference = f"tick {int(tick['number'])}: {_text(answer)}, not {_text(recorded)}"
        rows.add((int(tick["start_ns"]) - start_ns) * 1e-9, ecu.image())
    return TickReplay(np.asarray(rows.rows()), difference)


def _replay_tick(ecu: Backend, frames: NDArray[np.void], elapsed: int) -> list[Frame]:
    for frame in frames[frames["sent"] == 0]:
        length = int(frame["length"])
        ecu.receive(int(frame["ident"]), frame["payload"][:length], length)
    return list(ecu.tick(elapsed))


def _frame(entry: np.void) -> Frame:
    return int(entry["ident"]), bytes(entry["payload"][: int(entry["length"])])


def _text(frames: list[Frame]) -> str:
    return ", ".join(f"{ident:03X}#{payload.hex().upper()}" for ident, payload in frames) or "none"
