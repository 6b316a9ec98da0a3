"""Vehicle, nodes, driver and bus advanced together."""
