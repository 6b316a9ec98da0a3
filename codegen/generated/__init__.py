"""Generators of firmware sources: signals, frame sizes and limits."""
