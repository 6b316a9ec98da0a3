"""Further traffic on the bus: message sets, background load, recorded logs."""
