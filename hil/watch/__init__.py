"""Passive monitor of the roll controller's bus, and its live page."""
