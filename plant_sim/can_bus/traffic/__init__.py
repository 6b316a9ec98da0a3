"""What else is on the bus: message sets, background load, recorded logs."""
