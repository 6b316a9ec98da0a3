"""Logs of candump: its log format (``-L``, ``-l``), and what it prints to a terminal.

python-can reads the first alone, without error frames' channels, raw lengths and comments.
Source: lib.c and candump.c of can-utils.
"""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

import can

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.logs.lines import Line, LineError, Numbered
from canroll.plant_sim.can_bus.logs.remarks import Remarks

_LOGGED: Final = re.compile(
    r"\((?P<time>[^)]*)\)\s+(?P<channel>\S+)\s+(?P<ident>[0-9A-Fa-f]{1,8})#(?P<frame>\S*)"
    r"(?:\s+(?P<way>[RT]))?$"
)
_PRINTED: Final = re.compile(
    r"(?:\((?P<time>[^)]*)\)\s+)?(?P<channel>\S+)\s+(?:(?P<way>RX|TX)\s+[B-]\s+[E-]\s+)?"
    r"(?P<ident>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+(?:\[(?P<length>\d{1,2})\]|\{[0-9A-F]\})"
    r"(?:\s+(?P<remote>remote request)|(?P<data>(?:\s+[0-9A-Fa-f]{2}\b)*))"
    r"(?:\s+'.*'|\s+ERRORFRAME)?$"
)
_FRAME: Final = re.compile(
    r"(?:#(?P<flags>[0-9A-Fa-f]))?(?:[Rr](?P<remote>[0-8]?)|(?P<data>(?:\.?[0-9A-Fa-f]{2})*))"
    r"(?:_(?P<dlc>[9A-Fa-f]))?"
)
_XL: Final = re.compile(r"[0-9A-Fa-f]{1,8}:[0-9A-Fa-f]{2}:|[0-9A-Fa-f]{2}:[0-9A-Fa-f]{2}:")
_CONSOLE: Final = "Warning: console output active while logging!"
"""What candump itself prints, without an end of line, into what is logged."""
_ERROR: Final = 0x2000_0000
_IDENT: Final = 0x1FFF_FFFF
_SWITCH, _STATE = 1, 2
_STANDARD_DIGITS: Final = 3
WHAT: Final = "a line of candump"


def read(lines: Sequence[Line], remarks: Remarks) -> list[Numbered]:
    """Return the frames of a log.

    Raises:
        LineError: a line cannot be read.
        CanrollError: it has no times.
    """
    messages = []
    for line in lines:
        text = line.text.strip().removeprefix(_CONSOLE)
        if not text or text.startswith(("#", ";", "//")) or line.text.startswith("\t"):
            continue
        if logged := _LOGGED.match(text):
            if _XL.match(logged["frame"]):
                remarks.leave_out("CAN XL", line.number)
            else:
                messages.append(Numbered(line.number, _logged(line, logged)))
        elif printed := _PRINTED.match(text):
            messages.append(Numbered(line.number, _printed(line, printed)))
        else:
            raise LineError(line, f"not {WHAT}")
    return messages


def _logged(line: Line, match: re.Match[str]) -> can.Message:
    frame = _FRAME.fullmatch(match["frame"])
    if frame is None:
        raise LineError(line, f"not {WHAT}")
    flags = None if frame["flags"] is None else int(frame["flags"], 16)
    data = None if frame["data"] is None else bytes.fromhex(frame["data"].replace(".", ""))
    length = int(frame["remote"] or 0) if data is None else len(data)
    return _message(line, match, data, length, flags)


def _printed(line: Line, match: re.Match[str]) -> can.Message:
    data = None if match["remote"] else bytes.fromhex(match["data"])
    stated = match["length"]
    length = len(data or b"") if stated is None else int(stated)
    fd = stated is not None and len(stated) > 1
    if data is not None and len(data) < length:
        raise LineError(line, f"{len(data)} of {length} bytes")
    # bit-rate switch and error state are not printed, only whether the frame is an FD one
    return _message(line, match, data, length, 0 if fd else None)


def _message(
    line: Line, match: re.Match[str], data: bytes | None, length: int, flags: int | None
) -> can.Message:
    ident, channel = int(match["ident"], 16), match["channel"]
    error = bool(ident & _ERROR)
    return can.Message(
        timestamp=_seconds(line, match["time"]),
        arbitration_id=0 if error else ident & _IDENT,
        is_extended_id=len(match["ident"]) > _STANDARD_DIGITS,
        is_remote_frame=data is None,
        is_error_frame=error,
        is_fd=flags is not None,
        bitrate_switch=bool((flags or 0) & _SWITCH),
        error_state_indicator=bool((flags or 0) & _STATE),
        is_rx=match["way"] not in ("T", "TX"),
        channel=int(channel) if channel.isdecimal() else channel,
        dlc=0 if error else length,
        data=None if error else data,
    )


def _seconds(line: Line, text: str | None) -> float:
    if text is None:
        raise CanrollError("no times: record with 'candump -L', or with '-t a'")
    try:
        if "-" in text.strip()[1:]:
            return datetime.fromisoformat(text.strip()).replace(tzinfo=UTC).timestamp()
        return float(text)
    except ValueError as error:
        raise LineError(line, "not a time") from error
