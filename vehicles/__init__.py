"""Vehicles, one TOML file each, with the source of every number."""

from canroll.vehicles.actuators import ACTUATORS
from canroll.vehicles.load import embedded, from_table, load, names, note_of_change
from canroll.vehicles.model import GRAVITY, RollModel, Vehicle

if __name__ == "vehicles":  # not as a second copy, where the checkout is on the path
    raise ImportError("the package is canroll.vehicles")

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
