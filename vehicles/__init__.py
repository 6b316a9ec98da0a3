"""Vehicles, one TOML file each, with the source of every number."""

from vehicles.actuators import ACTUATORS
from vehicles.load import embedded, from_table, load, names, note_of_change
from vehicles.model import GRAVITY, RollModel, Vehicle

__all__ = [
    "ACTUATORS",
    "GRAVITY",
    "RollModel",
    "Vehicle",
    "embedded",
    "from_table",
    "load",
    "names",
    "note_of_change",
]
