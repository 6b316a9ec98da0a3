"""The bus contract ``roll_control.dbc``, the only interface between firmware and plant."""

from functools import cache
from pathlib import Path

import cantools
from cantools.database import Database, Message

PATH = Path(__file__).with_name("roll_control.dbc")


@cache
def load() -> Database:
    """Return the parsed ``roll_control.dbc``; one object for the whole process."""
    database = cantools.database.load_file(PATH)
    assert isinstance(database, Database)
    return database


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
