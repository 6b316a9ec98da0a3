"""The bus contract: ``roll_control.dbc`` is all that firmware and plant agree on."""

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
