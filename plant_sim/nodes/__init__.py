"""Sensors and actuators as nodes of the bus."""
