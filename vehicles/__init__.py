"""Vehicles, one TOML file each, with the source of every number."""

from vehicles.load import from_table, load, names
from vehicles.model import ACTUATORS, GRAVITY, RollModel, Vehicle

__all__ = ["ACTUATORS", "GRAVITY", "RollModel", "Vehicle", "from_table", "load", "names"]
