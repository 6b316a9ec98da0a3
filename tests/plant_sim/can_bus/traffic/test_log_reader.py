"""Logs whose fields are of other types than python-can writes are refused in one line."""

import sqlite3

import can
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.traffic.log_reader import read_log


@pytest.fixture
def log(tmp_path):
    """A log in a database, where a column may hold any type."""
    path = tmp_path / "log.db"
    with can.Logger(path) as written:
        for n in range(3):
            written(can.Message(1e-3 * n, 0x80, is_extended_id=False, data=b"12"))
    return path


def test_a_database_is_read(log):
    (logged,) = read_log(log).values()
    assert logged.ident.tolist() == [0x80] * 3


@pytest.mark.parametrize(
    "change",
    [
        "ts = NULL",
        "ts = 'late'",
        "ts = 5e9",
        "arbitration_id = NULL",
        "arbitration_id = 'Imu'",
        "dlc = 'long'",
        "data = 5.5",
    ],
)
def test_a_field_of_another_type_is_refused(change, log):
    database = sqlite3.connect(log)
    database.execute(f"UPDATE messages SET {change} WHERE rowid = 2")
    database.commit()
    database.close()
    with pytest.raises(CanrollError, match="not a readable bus log: ") as refusal:
        read_log(log)
    assert "\n" not in str(refusal.value)
