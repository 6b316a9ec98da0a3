"""Frames by cantools: of the bus contract packed, of a run's log decoded."""

from pathlib import Path
from typing import Any

import can
from cantools.database.can import Database
from numpy.typing import NDArray

from canroll import dbc
from canroll.runs.logs import write_log


def decoded(
    path: Path, frames: NDArray[Any], database: Database
) -> dict[str, list[tuple[float, Any, can.Message]]]:
    """Return time, values and frame of all of a run's frames by message, by way of a log."""
    messages = {(m.frame_id, m.is_extended_frame): m for m in database.messages}
    found: dict[str, list[tuple[float, Any, can.Message]]] = {}
    with can.LogReader(write_log(path, frames)) as log:
        for frame in log:
            message = messages.get((frame.arbitration_id, frame.is_extended_id))
            if message is not None:
                assert bool(frame.is_fd) == message.is_fd and len(frame.data) == message.length
                values = message.decode(bytes(frame.data), decode_choices=False)
                found.setdefault(message.name, []).append((frame.timestamp, values, frame))
    return found


def frame(name: str, **signals: float | str) -> tuple[int, bytes]:
    """Return identifier and payload of a message; signals that are not named are 0."""
    message = dbc.load().get_message_by_name(name)
    plain = (s for s in message.signals if not s.is_multiplexer and not s.multiplexer_ids)
    values: dict[str, float | str] = {signal.name: 0 for signal in plain}
    return message.frame_id, message.encode(values | signals, strict=True)
