"""Bus logs through python-can's writers, the same bytes for the same seed."""

from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import can
import numpy as np
from can.io import mf4

from canroll.errors import CanrollError, MissingExtraError, writing
from canroll.plant_sim.can_bus import DELIVERED, ECU, REFUSED
from canroll.plant_sim.can_bus.kernel.layout import ERROR
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, ERROR_STATE, EXTENDED, FD, REMOTE
from canroll.plant_sim.world.spool import Table, blocks
from canroll.runs import mdf

UNDER_WAY_NS = 1_000_000_000
"""Longer than any frame is under way on a segment between two entries of the log."""
SUFFIXES = (".asc", ".blf", ".log", ".mf4", ".pcap", ".pcapng")


def check_suffix(path: Path) -> Path:
    """Return ``path`` if its suffix is that of a log format.

    Raises:
        CanrollError: it is not, or the package for it is missing.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise CanrollError(f"{path}: the suffix of a log must be one of {', '.join(SUFFIXES)}")
    if suffix == ".mf4" and find_spec("asammdf") is None:
        raise MissingExtraError("--log FILE.mf4", "asammdf")
    return path


def _in_order(frames: Table) -> Iterator[np.void]:
    """Yield what a logger sees, by time; the log has it in order but for what is under way."""
    held = np.zeros(0, frames.dtype)
    for block in blocks(frames):
        seen = block[np.isin(block["outcome"], (DELIVERED, REFUSED, ERROR))]
        pool = np.concatenate((held, seen))
        pool = pool[np.argsort(pool["t_received"], kind="stable")]
        until = int(pool["t_received"][-1]) - UNDER_WAY_NS if len(pool) else 0
        done = int(np.searchsorted(pool["t_received"], until))
        yield from pool[:done]
        held = pool[done:]
    yield from held


def messages(frames: Table) -> Iterator[can.Message]:
    """Yield the messages seen by a logger on each segment, in order; time 0 is the run's start.

    Frames of the controller count as transmitted, all others as received; the channel is the
    segment. Error frames are included, frames that never reached the bus are not.
    """
    for entry in _in_order(frames):
        error = bool(entry["outcome"] == ERROR)
        flags = 0 if error else int(entry["flags"])
        length = 0 if error else int(entry["length"])
        remote = bool(flags & REMOTE)
        yield can.Message(
            timestamp=int(entry["t_received"]) * 1e-9,
            arbitration_id=0 if error else int(entry["ident"]),
            is_extended_id=bool(flags & EXTENDED),
            is_remote_frame=remote,
            is_error_frame=error,
            is_fd=bool(flags & FD),
            bitrate_switch=bool(flags & BIT_RATE_SWITCH),
            error_state_indicator=bool(flags & ERROR_STATE),
            is_rx=bool(entry["sender"] != ECU),
            channel=int(entry["segment"]),
            dlc=length,
            data=None if remote else entry["payload"][:length].tobytes(),
        )


def _start_at_zero(logger: Any) -> None:  # noqa: ANN401 - whichever writer the suffix has
    """Make time 0 of a log the start of the run.

    By default, .asc and .blf count from their first frame, .mf4 from the moment of writing.
    """
    if isinstance(logger, can.ASCWriter | can.BLFWriter):
        logger.log_event("Start of run", 0.0)
    elif isinstance(logger, mf4.MF4Writer):
        logger._mdf.header.start_time = datetime.fromtimestamp(0.0, UTC)
        logger._start_time = logger.last_timestamp = 0.0


def _logger(path: Path) -> Any:  # noqa: ANN401 - whichever writer the suffix has
    if path.suffix.lower() != ".mf4":
        return can.Logger(str(path))
    mdf.load()
    return mf4.MF4Writer(path)


def write_log(path: Path, frames: Table) -> Path:
    """Write a bus log in the format of ``path``'s suffix, and return ``path``.

    Raises:
        CanrollError: unknown suffix, the file cannot be written, or it is a .pcap and the frames
            are of several segments.
    """
    check_suffix(path)
    with writing(path), _logger(path) as logger:
        _start_at_zero(logger)
        for message in messages(frames):
            logger.on_message_received(message)
    return path
