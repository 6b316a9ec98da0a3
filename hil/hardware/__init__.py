"""Hardware interfaces: requirements, clock of the time stamps, bus errors and load."""
