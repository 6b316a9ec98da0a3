"""One run in virtual time: choices, simulation and verdict."""
