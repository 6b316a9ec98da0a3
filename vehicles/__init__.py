"""Vehicles, one TOML file each, with the source of every number."""

from vehicles.equipment import ACTUATORS
from vehicles.load import from_table, load, names
from vehicles.model import GRAVITY, RollModel, Vehicle

__all__ = ["ACTUATORS", "GRAVITY", "RollModel", "Vehicle", "from_table", "load", "names"]
