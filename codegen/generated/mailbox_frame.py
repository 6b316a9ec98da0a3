"""The frame of a mailbox: a message of the DBC, as the map says where the DBC lacks it or is wrong.

The keys ``id``, ``extended``, ``fd``, ``bytes`` and ``period_ms`` of a mailbox are named as those
of a message of a traffic set.
"""

from collections.abc import Collection, Mapping
from copy import copy
from typing import Any

from cantools.database import Message

from canroll import dbc
from canroll.dbc.reader import NetworkDescription, same_identifier
from canroll.errors import CanrollError, UnknownNameError

OVERRIDES = ("id", "extended", "fd", "bytes", "period_ms")
"""Keys of a mailbox that say of its frame what the DBC lacks or has wrong."""
CLASSIC = 8
"""Most bytes of a classic frame."""
STANDARD = (1 << 11) - 1
"""Largest identifier of 11 bits."""
_LONGEST_PERIOD = 10_000


def frame_of(network: NetworkDescription, table: Mapping[str, Any], where: str) -> Message:
    """Return the message of a mailbox's table, with what the table says of its frame.

    Raises:
        CanrollError: there is no such message or there are several, another has its identifier, or
            it is not possible on CAN.
    """
    name, database = table.get("message", ""), network.database
    named = [message for message in database.messages if message.name == name]
    if not isinstance(name, str) or not named:
        raise UnknownNameError(
            f"message in {where}", name, {message.name for message in database.messages}
        )
    files = network.described_in(name)
    if len(files) > 1:
        raise CanrollError(
            f"{where}: {name} is in {' and '.join(map(str, files))}: rename it in all but one"
        )
    if len(named) > 1:
        raise CanrollError(
            f"{where}: {len(named)} messages are named {name}: rename all but one in the DBC"
        )
    others = same_identifier(database, named[0])
    if others and "id" not in table:
        raise CanrollError(
            f"{where}: {' and '.join((name, *others))} have the identifier "
            f"0x{named[0].frame_id:X}: give that of {name} as id in the map"
        )
    message = _overridden(named[0], table, where)
    _refuse_impossible(message, where)
    return message


def period_ms(message: Message, table: Mapping[str, Any], where: str) -> float:
    """Return the time between two frames, from the map, else from the DBC; 0: neither has it."""
    given = [key for key in ("period_ms", "cycle_ms") if key in table]
    if len(given) > 1:
        raise CanrollError(f"{where}: period_ms and cycle_ms are the same: give one of them")
    value = table[given[0]] if given else message.cycle_time or 0
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not (value == 0 or 1 <= value <= _LONGEST_PERIOD):
        raise CanrollError(
            f"{where}: {given[0] if given else 'GenMsgCycleTime'} must be a number from 1 to "
            f"{_LONGEST_PERIOD}, not {value!r}"
        )
    return float(value) if value % 1 else int(value)


def with_signals(message: Message, names: Collection[str], length: int) -> Message:
    """Return a message of ``length`` bytes with some of its signals, each on all pages.

    Others may overlap them: cantools decodes no message with both.
    """
    signals = []
    for signal in message.signals:
        if signal.name in names:
            plain = copy(signal)
            plain.is_multiplexer, plain.multiplexer_ids = False, None
            plain.multiplexer_signal = None
            signals.append(plain)
    return Message(
        message.frame_id,
        message.name,
        length,
        signals,
        is_extended_frame=message.is_extended_frame,
        is_fd=message.is_fd,
        strict=False,
    )


def _overridden(message: Message, table: Mapping[str, Any], where: str) -> Message:
    for key in ("extended", "fd"):
        if not isinstance(table.get(key, False), bool):
            raise CanrollError(f"{where}: {key} must be true or false, not {table[key]!r}")
    for key, most in (("id", (1 << 29) - 1), ("bytes", dbc.FD_LENGTHS[-1])):
        if not _is_whole(table.get(key, 0), most):
            raise CanrollError(
                f"{where}: {key} must be a whole number up to {most}, not {table[key]!r}"
            )
    frame = copy(message)
    if "id" in table:
        frame.frame_id = table["id"]
        frame.is_extended_frame = table["id"] > STANDARD
    frame.is_extended_frame = table.get("extended", frame.is_extended_frame)
    frame.is_fd = table.get("fd", frame.is_fd)
    frame.length = table.get("bytes", frame.length)
    return frame


def _is_whole(value: object, most: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= most


def _refuse_impossible(message: Message, where: str) -> None:
    """Refuse what no frame can be: too long, without any byte, or with too large an identifier."""
    name, length = message.name, message.length
    if length > CLASSIC and not message.is_fd:
        raise CanrollError(
            f"{where}: {name} has {length} bytes but is not a CAN FD frame: give fd = true in the "
            "map, or set its VFrameFormat to StandardCAN_FD or ExtendedCAN_FD in the DBC"
        )
    if length > dbc.FD_LENGTHS[-1]:
        raise CanrollError(
            f"{where}: {name} has {length} bytes; a frame has at most {dbc.FD_LENGTHS[-1]}"
        )
    if length == 0:
        raise CanrollError(
            f"{where}: {name} has 0 bytes, which carry no signal: give its bytes in the map"
        )
    if message.frame_id > STANDARD and not message.is_extended_frame:
        raise CanrollError(
            f"{where}: {name} has the identifier 0x{message.frame_id:X} in 11 bits: give "
            "extended = true in the map, or mark it as extended in the DBC"
        )
