"""Logs in MDF 4 (``.mf4``, ASAM) and in python-can's SQLite tables (``.db``), by its readers."""

import sqlite3
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import can

from canroll import documents
from canroll.errors import CanrollError, MissingExtraError
from canroll.plant_sim.can_bus.kernel.layout import MAX_PAYLOAD
from canroll.plant_sim.can_bus.logs.lines import Numbered
from canroll.plant_sim.can_bus.logs.remarks import Remarks

_FIELDS: Final = (
    *("timestamp", "arbitration_id", "is_extended_id", "is_remote_frame", "is_error_frame"),
    *("is_fd", "bitrate_switch", "error_state_indicator", "is_rx"),
)
_MF4_TO_NPZ: Final = f"""
import logging, sys, can, numpy
logging.disable()
names = "CAN_DataFrame", "CAN_ErrorFrame", "CAN_RemoteFrame"
with can.LogReader(sys.argv[1]) as reader:
    messages = list(reader)
    counts = [
        sum(
            group.channel_group.cycles_nr
            for group in reader._mdf.groups
            if any(str(channel.name).partition(".")[0] == name for channel in group.channels)
        )
        for name in names
    ]
data = numpy.zeros((len(messages), {MAX_PAYLOAD}), numpy.uint8)
for row, message in zip(data, messages):
    row[: len(message.data)] = list(message.data)
columns = {{name: numpy.array([getattr(m, name) for m in messages]) for name in {_FIELDS}}}
channel = [-1 if m.channel is None else m.channel for m in messages]
columns["channel"] = numpy.array(channel)
columns["dlc"] = numpy.array([m.dlc for m in messages])
numpy.savez(sys.stdout.buffer, data=data, counts=numpy.array(counts), **columns)
"""
"""asammdf is ended by some damaged files."""
_KINDS: Final = ("data frames", "error frames", "remote frames")
DAMAGED_MF4: Final = "damaged, or not an MF4"
DAMAGED_DB: Final = "damaged, or not an SQLite log of python-can"


def read_mf4(path: Path, remarks: Remarks) -> list[Numbered]:
    """Return the frames of an MF4 with bus logging.

    Raises:
        MissingExtraError: asammdf is not installed.
        CanrollError: it cannot be read, or has no bus logging.
    """
    if find_spec("asammdf") is None:
        raise MissingExtraError("reading an .mf4", "asammdf")
    try:
        table = documents.read_apart(_MF4_TO_NPZ, path)
    except ValueError as error:
        raise CanrollError(DAMAGED_MF4) from error
    if not table["counts"].any():
        raise CanrollError("an MF4 without CAN frames: its bus logging is needed, not its signals")
    columns = [table[name].tolist() for name in (*_FIELDS, "channel", "dlc")]
    messages = [
        can.Message(
            **dict(zip(_FIELDS, row, strict=True)),
            channel=None if channel < 0 else channel,
            dlc=length,
            data=None if row[_FIELDS.index("is_remote_frame")] else data[:length].tobytes(),
        )
        for *row, channel, length, data in zip(*columns, table["data"], strict=True)
    ]
    errors = sum(message.is_error_frame for message in messages)
    remote = sum(message.is_remote_frame and not message.is_error_frame for message in messages)
    reads = len(messages) - errors - remote, errors, remote
    for kind, stated, count in zip(_KINDS, table["counts"].tolist(), reads, strict=True):
        if stated != count:
            remarks.add(f"{stated} {kind} are there, {count} can be read")
    return [Numbered(number, message) for number, message in enumerate(messages, 1)]


def read_db(path: Path, _: Remarks) -> list[Numbered]:
    """Return the frames of a table; SQLite gives all of its rows or an error.

    Raises:
        CanrollError: it cannot be read.
    """
    try:
        with can.SqliteReader(path) as reader:
            return [Numbered(number, message) for number, message in enumerate(reader, 1)]
    except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
        raise CanrollError(DAMAGED_DB) from error
