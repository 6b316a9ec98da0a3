"""Emission of the subset as C99."""
