"""A program's memory that lasts from start to start, on a bus with authenticated frames.

A node counts its starts and remembers the starts of the senders that it hears; both are part of the
freshness values of frames. The file is a JSON object: {"starts": 3, "senders": {"Imu": 2}}.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from canroll import documents
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.secured import Lasting
from canroll.errors import CanrollError, reading, writing
from canroll.firmware.security.secoc_state import RESET_MAX


@dataclass(frozen=True, slots=True)
class LastingCounts:
    """Starts of a program so far, and of each sender that it knows."""

    starts: int = 0
    senders: Mapping[str, int] = field(default_factory=dict)


FIRST = LastingCounts()
"""That of a program that was never started."""


def read(path: Path | None) -> LastingCounts:
    """Return the memory in a file; that of the first start without one.

    Raises:
        CanrollError: it cannot be read, or holds no such memory.
    """
    if path is None or not path.exists():
        return FIRST
    with reading(path):
        data = documents.parse_json(documents.text(path))
    named = isinstance(data, dict) and set(data) == {"starts", "senders"}
    if not named or not isinstance(data["senders"], dict):
        raise CanrollError(f'{path}: expected {{"starts": N, "senders": {{NAME: N}}}}: delete it')
    for name, value in {"starts": data["starts"], **data["senders"]}.items():
        if type(value) is not int or not 0 <= value <= RESET_MAX:
            raise CanrollError(f"{path}: {name} must be a whole number from 0 to {RESET_MAX}")
    return LastingCounts(data["starts"], data["senders"])


def write(path: Path | None, memory: LastingCounts) -> None:
    """Write the memory to a file, if one is given.

    Raises:
        CanrollError: it cannot be written.
    """
    if path is None:
        return
    text = json.dumps({"starts": memory.starts, "senders": dict(memory.senders)}) + "\n"
    part = path.with_name(f"{path.name}.part")
    with writing(path):
        part.write_text(text, encoding="utf-8")
        part.replace(path)


def of_ecu(memory: LastingCounts, firmware: BusFirmware) -> Lasting:
    """Return the memory as the ECU's mailboxes have it."""
    boxes = firmware.bus.received
    return Lasting(memory.starts, tuple(memory.senders.get(box.name, 0) for box in boxes))


def by_name(lasting: Lasting, firmware: BusFirmware) -> LastingCounts:
    """Return the memory of an ECU with the messages' names."""
    named = zip(firmware.bus.received, lasting.senders, strict=False)
    return LastingCounts(lasting.starts, {box.name: starts for box, starts in named if box.name})
