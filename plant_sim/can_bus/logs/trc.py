"""Traces of PEAK's tools (``.trc``), versions 1.0 to 2.1, through python-can's reader.

It does not know version 1.2, passes over error frames, and takes the length of an FD frame for
its DLC.
Source: PEAK CAN TRC File Format.
"""

import re
from collections.abc import Iterator, Sequence
from typing import Final

import can
from can.util import dlc2len

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.logs.lines import Line, LineError, Numbered, parsed
from canroll.plant_sim.can_bus.logs.remarks import Remarks

_VERSION: Final = re.compile(r";\$FILEVERSION=\s*(\S+)")
_COLUMNS: Final = re.compile(r";\$COLUMNS=\s*(\S+)")
_KNOWN: Final = ("1.0", "1.1", "1.2", "1.3", "2.0", "2.1")
_EARLY: Final = {"1.0": "N,O,I", "1.1": "N,O,T,I", "1.2": "N,O,B,T,I", "1.3": "N,O,B,T,I"}
"""First columns of the versions that do not state them."""
_ERRORS: Final = ("ER", "Error")
_STATES: Final = ("ST", "EC", "EV", "Warng", "Event")
"""Types of lines that say something of a bus or its controller and are no frames."""
_STATE_IDENT: Final = "FFFFFFFF"
"""Identifier of such a line in version 1.0."""
WHAT: Final = "a line of a .trc"


def read(lines: Sequence[Line], remarks: Remarks) -> list[Numbered]:
    """Return the frames of a trace.

    Raises:
        LineError: a line cannot be read.
        CanrollError: another version.
    """
    head = [line for line in lines if line.text.startswith(";$")]
    version = next((m[1] for line in head if (m := _VERSION.match(line.text))), "1.0")
    if version not in _KNOWN:
        raise CanrollError(f"a .trc of version {version}: {', '.join(_KNOWN)} are read")
    stated = next((m[1] for line in head if (m := _COLUMNS.match(line.text))), "")
    stated = _EARLY.get(version, stated)
    columns = {name: place for place, name in enumerate(stated.split(","))}
    if not {"O", "I"} <= set(columns):
        raise CanrollError("the header has no $COLUMNS with offset (O) and identifier (I)")
    frames, errors = [], []
    for line in lines:
        words = line.text.split()
        if not words or words[0].startswith(";"):
            continue
        kind = words[columns["T"]] if "T" in columns and columns["T"] < len(words) else ""
        if kind in _ERRORS:
            errors.append(Numbered(line.number, _error(line, words, columns)))
        elif kind not in _STATES and words[columns["I"] : columns["I"] + 1] != [_STATE_IDENT]:
            frames.append(line)
    messages = list(parsed(can.TRCReader, _feed(head, frames, version), WHAT)) if frames else []
    missing = {line.number for line in frames} - {entry.number for entry in messages}
    if missing:
        raise LineError(lines[min(missing) - 1], f"not {WHAT}")
    # what python-can adds to the offsets of a trace
    first = float(frames[0].text.split()[1]) / 1000 if messages else 0.0
    start = messages[0].message.timestamp - first if messages else 0.0
    for entry in messages:
        if entry.message.is_fd:
            entry.message.dlc = dlc2len(entry.message.dlc)
    for entry in errors:
        entry.message.timestamp += start
    return sorted([*messages, *errors])


def _feed(head: Sequence[Line], frames: Sequence[Line], version: str) -> Iterator[tuple[Line, str]]:
    for line in head:
        match = _VERSION.match(line.text)
        yield line, line.text.replace("1.2", "1.3") if match else line.text
    for line in frames:
        text = line.text
        if version == "1.2":
            # 1.3 has one more column, reserved, behind the identifier
            words = text.split()
            text = " ".join([*words[:5], "-", *words[5:]])
        yield line, text


def _error(line: Line, words: Sequence[str], columns: dict[str, int]) -> can.Message:
    try:
        return can.Message(
            timestamp=float(words[columns["O"]]) / 1000,
            is_error_frame=True,
            channel=int(words[columns["B"]]) if "B" in columns else 1,
        )
    except (ValueError, IndexError) as error:
        raise LineError(line, f"not {WHAT}") from error
