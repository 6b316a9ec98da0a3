"""A run as MCAP, which Foxglove opens: a topic of signals, a topic of frames for each bus.

Messages are JSON with a schema each; time 0 is the start of the run. The same run gives the same
bytes.
"""

import json
from collections.abc import Mapping
from math import isnan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.errors import optional
from canroll.plant_sim.world.recording import unit
from canroll.plant_sim.world.spool import Table, pieces
from canroll.report.signal_files import About, Format
from canroll.runs.logs import messages

SIGNALS = "/vehicle"
FRAMES = "/can"
FRAME_SCHEMA = {
    "type": "object",
    "properties": {
        "id": {"type": "integer"},
        "extended": {"type": "boolean"},
        "fd": {"type": "boolean"},
        "sent": {"type": "boolean", "description": "by the roll controller"},
        "error": {"type": "boolean"},
        "data": {"type": "string", "description": "hexadecimal"},
    },
}


def write(path: Path, signals: Mapping[str, NDArray[np.float64]], about: About) -> None:
    """Write a file.

    Raises:
        OSError: it cannot be written.
    """
    writing = optional("mcap.writer", "an MCAP file", "mcap")
    with path.open("wb") as file:
        writer = writing.Writer(file)
        writer.start(profile="", library="canroll")
        writer.add_metadata("canroll", dict(about.texts))
        for described in about.dbc:
            writer.add_attachment(0, 0, described.name, "text/plain", described.read_bytes())
        names = [name for name in signals if name != "time"]
        properties = {name: {"type": "number", "description": unit(name)} for name in names}
        schema = {"type": "object", "properties": properties}
        channel = _channel(writer, SIGNALS, "canroll.Vehicle", schema)
        for times, *columns in pieces(signals, "time", *names):
            rows = np.column_stack(columns).tolist()
            for time, row in zip(_nanoseconds(times), rows, strict=True):
                # JSON has no NaN
                values = {name: None if isnan(x) else x for name, x in zip(names, row, strict=True)}
                text = json.dumps(values, allow_nan=False)
                writer.add_message(channel, time, text.encode(), time)
        if about.frames is not None:
            _write_frames(writer, about.frames)
        writer.finish()


def _nanoseconds(times: NDArray[np.float64]) -> list[int]:
    nanoseconds: list[int] = np.round(1e9 * times).astype(np.int64).tolist()
    return nanoseconds


def _channel(writer: object, topic: str, name: str, schema: Mapping[str, object]) -> int:
    data = json.dumps(schema).encode()
    ident = writer.register_schema(name, "jsonschema", data)  # type: ignore[attr-defined]
    return int(writer.register_channel(topic, "json", ident))  # type: ignore[attr-defined]


def _write_frames(writer: object, frames: Table) -> None:
    channels: dict[int, int] = {}
    for message in messages(frames):
        segment = int(str(message.channel))
        if segment not in channels:
            channels[segment] = _channel(
                writer, f"{FRAMES}/{segment}", "canroll.Frame", FRAME_SCHEMA
            )
        text = {
            "id": message.arbitration_id,
            "extended": message.is_extended_id,
            "fd": message.is_fd,
            "sent": not message.is_rx,
            "error": message.is_error_frame,
            "data": bytes(message.data).hex(),
        }
        time = round(1e9 * message.timestamp)
        data = json.dumps(text).encode()
        writer.add_message(channels[segment], time, data, time)  # type: ignore[attr-defined]


MCAP = Format(write, "mcap", "mcap")
