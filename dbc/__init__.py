"""The bus contract ``roll_control.dbc``, the only interface between firmware and plant."""

from functools import cache
from pathlib import Path

import cantools
from cantools.database import Database, Message

from canroll.dbc.reader import Files, network

if __name__ == "dbc":  # not as a second copy, where the checkout is on the path
    raise ImportError("the package is canroll.dbc")

PATH = Path(__file__).with_name("roll_control.dbc")
FD_PATH = PATH.with_name("roll_control_fd.dbc")
"""The same signals in CAN FD frames."""
FD_MAP = FD_PATH.with_suffix(".toml")
SECURED_PATH = PATH.with_name("roll_control_secured.dbc")
"""The same signals in authenticated CAN FD frames."""
SECURED_MAP = SECURED_PATH.with_suffix(".toml")
FD_LENGTHS: tuple[int, ...] = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Payload bytes by length code (DLC) of a CAN FD frame, ISO 11898-1:2015."""


@cache
def load() -> Database:
    """Return the parsed ``roll_control.dbc``; one object for the whole process."""
    database = cantools.database.load_file(PATH)
    assert isinstance(database, Database)
    return database


def read(files: Files) -> tuple[Database, tuple[str, ...]]:
    """Read a network description: DBC, KCD, ARXML or SYM, or the messages of several together.

    One that breaks the rules of its format, as with overlapping signals, is read all the same.

    Returns:
        database: the messages.
        warnings: what had to be left out or assumed, none or one line for each file.

    Raises:
        CanrollError: one is none of these files, or not one of CAN.
    """
    description = network(files)
    return description.database, description.warnings


def attribute(source: Database | Message, name: str, default: int = 0) -> int:
    """Return an attribute as a number, or the index of its choice: as set, else the default."""
    if not source.dbc:
        return default
    entry = source.dbc.attributes.get(name)
    definition = source.dbc.attribute_definitions.get(name)
    value = entry.value if entry else definition.default_value if definition else None
    if value is None:
        return default
    choices = list(definition.choices or ()) if definition else []
    return choices.index(value) if value in choices else int(float(value))


def switches_bit_rate(message: Message) -> bool:
    """Return whether the data phase of a message has the bus's second, faster bit rate."""
    return bool(message.is_fd) and bool(attribute(message, "CANFD_BRS", 1))


def padded(length: int) -> int:
    """Return the length on the wire of a frame of ``length`` bytes: the next length code's."""
    return min(size for size in FD_LENGTHS if size >= length)


def data_id(message: Message) -> int:
    """Return the 16-bit E2E profile 1 data id of ``message``, 0 where it has no protection."""
    assert message.dbc is not None
    attribute = message.dbc.attributes.get("E2EDataId")
    return int(attribute.value) if attribute else 0


def message(name: str) -> Message:
    """Return a message of the contract."""
    return load().get_message_by_name(name)


def period(name: str) -> float:
    """Return the time from one frame of a message to the next, s."""
    cycle = message(name).cycle_time
    assert cycle is not None
    return 1e-3 * float(cycle)


def largest(name: str, signal: str) -> float:
    """Return the largest value of a signal, in its unit."""
    maximum = message(name).get_signal_by_name(signal).maximum
    assert maximum is not None
    return float(maximum)


def names(name: str, signal: str) -> tuple[str, ...]:
    """Return the names of an enumeration's values, from 0."""
    choices = message(name).get_signal_by_name(signal).choices or {}
    return tuple(str(choices[value]) for value in sorted(choices))
