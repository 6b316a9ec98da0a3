"""Passive monitor of the roll controller's bus."""
