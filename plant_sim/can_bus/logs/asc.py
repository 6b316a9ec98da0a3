"""Logs of Vector's tools in text (``.asc``), of BUSMASTER and of python-can.

python-can's reader parses the frames. It takes relative times for absolute ones, drops the line
after a header that does not end as it expects, and lines with other times than it expects; so
it gets the lines of frames alone, without times, behind a header of our own.
"""

import re
from collections.abc import Iterator, Sequence
from typing import Final

import can

from canroll.plant_sim.can_bus.logs.lines import Line, LineError, Numbered, parsed
from canroll.plant_sim.can_bus.logs.remarks import Remarks

_BASE: Final = re.compile(
    r"base\s+(hex|dec)(?:\s+timestamps\s+(?P<times>absolute|relative))?", re.IGNORECASE
)
_EVENT: Final = re.compile(r"(?P<time>-?\d+(?:[.,]\d+)?)\s+(?P<rest>\S.*)")
_FRAME: Final = re.compile(
    r"CANFD\s+\d+\s+(Rx|Tx)\s|\d+\s+(ErrorFrame|\S+\s+(?P<way>Rx|Tx|TxRq)(\s|$))", re.IGNORECASE
)
_OVERLOAD: Final = re.compile(r"(?:CANFD\s+)?\d+\s+OverloadFrame", re.IGNORECASE)
_START: Final = "Start of"
_BYTES: Final = re.compile(r"\d+\s+\S+\s+\S+\s+d\s+\S+(?P<data>(?:\s+[0-9A-Fa-f]{1,3}(?=\s|$))*)")
_MOST_CLASSIC: Final = 8
_FDF: Final = 0x1000
"""Bit of a CANFD line's flags: an FD frame; without it a classic one on an FD channel."""
_REMOTE: Final = 0x10
WHAT: Final = "a frame of an .asc"


def read(lines: Sequence[Line], remarks: Remarks) -> list[Numbered]:
    """Return the frames of a log.

    Raises:
        LineError: a line cannot be read.
    """
    times: dict[int, float] = {}
    rests: dict[int, str] = {}
    events: list[Line] = []
    decimal = relative = False
    clock = 0.0
    for line in lines:
        text = line.text.strip()
        base = _BASE.match(text)
        if base:
            if rests and decimal != (base[1].lower() == "dec"):
                raise LineError(line, "the base of the numbers changes: cut the file before it")
            decimal = base[1].lower() == "dec"
            relative = (base["times"] or "").lower() == "relative"
        event = _EVENT.match(text)
        if event is None:
            continue
        time = float(event["time"].replace(",", "."))
        # relative to the last event, whether that was a frame or not
        clock = clock + time if relative else time
        frame = _FRAME.match(event["rest"])
        if frame is None:
            if _OVERLOAD.match(event["rest"]):
                remarks.leave_out("an overload frame", line.number)
            elif not event["rest"].startswith(_START):
                events.append(line)
            continue
        if (frame["way"] or "").lower() == "txrq":
            remarks.leave_out("a request to send (TxRq), no frame", line.number)
            continue
        times[line.number] = clock
        rests[line.number] = _decimal(event["rest"]) if decimal else event["rest"]
    if events and not rests:
        raise LineError(events[0], f"not {WHAT}, as no other line is")
    messages = []
    for number, message in parsed(can.ASCReader, _feed(lines, rests, decimal), WHAT):
        message.timestamp = times.pop(number)
        rest = rests[number]
        surplus = "" if message.is_fd else _surplus(rest)
        if surplus:
            remarks.leave_out(surplus, number)
            continue
        messages.append(Numbered(number, _classic(message, rest) if message.is_fd else message))
    if times:
        raise LineError(lines[min(times) - 1], f"not {WHAT}")
    return messages


def _feed(
    lines: Sequence[Line], rests: dict[int, str], decimal: bool
) -> Iterator[tuple[Line, str]]:
    """Yield a header as python-can expects it, and the lines of the frames."""
    yield Line(0, ""), f"base {'dec' if decimal else 'hex'}  timestamps absolute"
    yield Line(0, ""), "no internal events logged"
    for line in lines:
        if line.number in rests:
            yield line, f"0.0 {rests[line.number]}"


def _decimal(rest: str) -> str:
    """Return the line of an FD frame with its DLC, which is always hexadecimal, to base 10."""
    words = rest.split()
    place = _length_code(words)
    if place is None:
        return rest
    try:
        words[place] = str(int(words[place], 16))
    except ValueError:
        return rest
    return " ".join(words)


def _length_code(words: Sequence[str]) -> int | None:
    """Return the place of an FD frame's DLC: behind identifier, name if any, BRS and ESI."""
    if words[0] != "CANFD" or len(words) < 8 or words[3].lower() == "errorframe":
        return None
    return 6 if words[4].isdigit() else 7


def _surplus(rest: str) -> str:
    """Return what is wrong with a classic frame of more bytes than it can have."""
    match = _BYTES.match(rest)
    size = len(match["data"].split()) if match else 0
    return f"{size} bytes in a classic frame" if size > _MOST_CLASSIC else ""


def _classic(message: can.Message, rest: str) -> can.Message:
    """Return a message of a CANFD line as a classic frame if its flags say so."""
    words = rest.split()
    place = _length_code(words)
    if place is None or message.bitrate_switch or message.dlc > _MOST_CLASSIC:
        return message
    flags = place + 2 + len(message.data) + 2
    try:
        bits = int(words[flags], 16)
    except (ValueError, IndexError):
        return message
    if not bits & _FDF:
        message.is_fd = False
        message.is_remote_frame = bool(bits & _REMOTE)
    return message
