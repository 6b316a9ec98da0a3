"""Frames of a bus log by channel, from every format that is read, by its suffix."""

import gzip
import io
import tempfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import can
import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, UnknownNameError, reason
from canroll.plant_sim.buses import LOGS, PACKED
from canroll.plant_sim.can_bus.kernel.layout import MAX_PAYLOAD
from canroll.plant_sim.can_bus.logs import asc, blf, candump, csv, databases, trc
from canroll.plant_sim.can_bus.logs.lines import LineError, Numbered, lines_of
from canroll.plant_sim.can_bus.logs.remarks import Remarks, possible
from canroll.plant_sim.can_bus.logs.sections import find_sections
from canroll.plant_sim.can_bus.traffic.log_name import is_log, suffix_of
from canroll.plant_sim.can_bus.traffic.pcap import CaptureReader
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD, REMOTE, frame_bits

_TEXTS: Final = {".asc": asc.read, ".log": candump.read, ".csv": csv.read, ".trc": trc.read}
_FILES: Final = {".mf4": databases.read_mf4, ".db": databases.read_db}

LATEST: Final = 4e9
"""Largest time stamp of a frame, s, since 1970 or the start: it fits 63 bits in ns."""

Progress = Callable[[str, float], None]
"""Called with the activity and the fraction done."""


class Logged(NamedTuple):
    """One channel of a log in the order of reception, one entry per frame.

    Times of reception in nanoseconds, 0 at the log's first frame of any channel, or at the first
    one of a section; whole microseconds, which is what logs hold. ``nominal_bits`` and
    ``data_bits``: lengths on the wire, see ``frame_bits``. ``errors_ns``: times of the error
    frames, which are not among the others. ``remarks``: what was left out, and why.
    """

    channel: str
    received_ns: NDArray[np.int64]
    ident: NDArray[np.int64]
    flags: NDArray[np.int64]
    length: NDArray[np.int64]
    payload: NDArray[np.uint8]
    nominal_bits: NDArray[np.int64]
    data_bits: NDArray[np.int64]
    errors_ns: NDArray[np.int64]
    remarks: tuple[str, ...]


def read_log(
    path: Path, *, section: int | None = None, progress: Progress | None = None
) -> dict[str, Logged]:
    """Return the channels of a log by name, as python-can names them.

    Args:
        path: the log; its suffix is one of :data:`LOGS`, with .gz behind it if it is packed.
        section: which one to read of a log whose times step; None: that with most frames.
        progress: called while the file is read.

    Raises:
        CanrollError: the file cannot be read, or has no such section.
    """
    if not path.is_file():
        raise CanrollError(f"{path}: no such file")
    if not is_log(path):
        raise CanrollError(f"{path}: a bus log ends in {', '.join(LOGS)}, or these and .gz")
    remarks = Remarks("line" if suffix_of(path) in _TEXTS else "frame")
    report = progress or (lambda stage, share: None)
    try:
        report(f"read {path.name}", 0.0)
        entries = possible(_entries(path, remarks), remarks)
        report(f"read {path.name}", 0.5)
        channels = _channels(entries, remarks.texts(), section)
        report(f"read {path.name}", 1.0)
    except CanrollError as error:
        raise CanrollError(f"{path}: not a readable bus log: {error}") from error
    except OSError as error:
        raise CanrollError(f"{path}: not a readable bus log: {reason(error)}") from error
    except Exception as error:  # a reader of python-can passes on any error of its parser
        raise CanrollError(f"{path}: not a readable bus log: damaged") from error
    if not channels:
        raise CanrollError("; ".join([f"{path}: contains no frame", *remarks.texts()]))
    return channels


def _entries(path: Path, remarks: Remarks) -> list[Numbered]:
    suffix = suffix_of(path)
    packed = path.suffix.lower() == PACKED
    if suffix in _FILES and not packed:
        return _FILES[suffix](path, remarks)
    content = _unpacked(path) if packed else path.read_bytes()
    if suffix in _TEXTS:
        return _read_lines(suffix, content, remarks)
    if suffix == ".blf":
        return blf.read(content, remarks)
    if suffix in _FILES:
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / path.stem
            copy.write_bytes(content)
            return _FILES[suffix](copy, remarks)
    return [Numbered(n, message) for n, message in enumerate(CaptureReader(io.BytesIO(content)), 1)]


def _unpacked(path: Path) -> bytes:
    try:
        with gzip.open(path) as file:
            return file.read()
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise CanrollError("damaged, or not packed by gzip") from error


def _read_lines(suffix: str, content: bytes, remarks: Remarks) -> list[Numbered]:
    """Read a log in text; a last line without an end was being written."""
    lines, complete = lines_of(content)
    try:
        return _TEXTS[suffix](lines, remarks)
    except LineError as error:
        if complete or error.number < len(lines):
            raise
        entries = _TEXTS[suffix](lines[:-1], remarks)
        remarks.leave_out("the file is cut off within it", error.number)
        return entries


def _channels(
    entries: Sequence[Numbered], remarks: tuple[str, ...], section: int | None
) -> dict[str, Logged]:
    """Sort messages by channel; a field of one, as those of a .db, may be of any type."""
    channels: dict[str, list[can.Message]] = {}
    try:
        if not all(abs(entry.message.timestamp) < LATEST for entry in entries):
            raise CanrollError(f"a time is beyond {LATEST:g} s")
        for entry in entries:
            channels.setdefault(str(entry.message.channel), []).append(entry.message)
        start = entries[0].message.timestamp if entries else 0.0
        stamps = {
            name: np.array([round((m.timestamp - start) * 1e6) * 1000 for m in entry], np.int64)
            for name, entry in channels.items()
        }
        sections = {name: find_sections(times) for name, times in stamps.items()}
        most = max((len(known.rows) for known in sections.values()), default=0)
        if section is not None and not 1 <= section <= most:
            raise CanrollError(f"--section {section}: there are sections 1 to {most}")
        chosen = {
            name: known.choose(section)
            for name, known in sorted(sections.items())
            if section is None or section <= len(known.rows)
        }
        return {
            name: _logged(name, channels[name], stamps[name], rows)._replace(
                remarks=(*remarks, f"channel {name}: {step}") if step else remarks
            )
            for name, (rows, step) in chosen.items()
        }
    except (ValueError, TypeError, OverflowError, AttributeError) as error:
        raise CanrollError("damaged: a field of a frame has another type") from error


def select_channel(path: Path, channels: dict[str, Logged], name: str | None) -> Logged:
    """Return a channel by name; None: the only one that has frames.

    Raises:
        CanrollError: no frame, or frames of several channels and none is chosen.
        UnknownNameError: there is no such channel.
    """
    known = [channel for channel, logged in channels.items() if len(logged.ident)]
    if not known:
        raise CanrollError(f"{path}: contains no frame")
    if name is None and len(known) > 1:
        raise CanrollError(
            f"{path}: frames of channels {', '.join(known)}: choose one with --channel"
        )
    if name is not None and name not in known:
        raise UnknownNameError(f"channel of {path}", name, known)
    return channels[name or known[0]]


def _logged(
    channel: str,
    messages: list[can.Message],
    stamps: NDArray[np.int64],
    rows: NDArray[np.int64],
) -> Logged:
    """Return the messages of a channel in a section's rows, in the order of their times."""
    if len(rows) < len(stamps):
        stamps = stamps - stamps[rows].min()
    rows = rows[np.argsort(stamps[rows], kind="stable")]
    errors = np.array([messages[row].is_error_frame for row in rows], bool)
    chosen = rows[~errors]
    frames = [messages[row] for row in chosen]
    payload = np.zeros((len(frames), MAX_PAYLOAD), np.uint8)
    ident = np.array([m.arbitration_id for m in frames], np.int64)
    length = np.array([min(m.dlc, MAX_PAYLOAD if m.is_fd else 8) for m in frames], np.int64)
    flags = np.array([flags_of(m) for m in frames], np.int64)
    bits = np.zeros((len(frames), 2), np.int64)
    for i, message in enumerate(frames):
        data = bytes(message.data or b"")
        count = min(len(data), int(length[i]))
        payload[i, :count] = np.frombuffer(data, np.uint8)[:count]
        bits[i] = frame_bits(int(ident[i]), int(flags[i]), int(length[i]), payload[i])
    return Logged(
        channel,
        stamps[chosen],
        ident,
        flags,
        length,
        payload,
        bits[:, 0],
        bits[:, 1],
        stamps[rows[errors]],
        (),
    )


def transmission_times(
    nominal: NDArray[np.int64], data: NDArray[np.int64], bitrate: int, data_bitrate: int
) -> NDArray[np.int64]:
    """Return the transmission times of frames, ns; ``data_bitrate`` 0: as nominal."""

    def rounded(bits: NDArray[np.int64], rate: int) -> NDArray[np.int64]:
        time: NDArray[np.int64] = (bits * 1_000_000_000 + rate // 2) // rate
        return time

    total: NDArray[np.int64] = rounded(nominal, bitrate) + rounded(data, data_bitrate or bitrate)
    return total


def flags_of(message: can.Message) -> int:
    """Return a python-can message's flags, those of :mod:`canroll.plant_sim.can_bus.wire.frame`."""
    flags = EXTENDED if message.is_extended_id else 0
    if message.is_fd:
        # FD has no remote frames, though python-can reads an empty one of an .asc as such
        return flags | FD | (BIT_RATE_SWITCH if message.bitrate_switch else 0)
    return flags | (REMOTE if message.is_remote_frame else 0)
