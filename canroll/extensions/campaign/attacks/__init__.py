"""Attackers on the bus: what they send, and what became of it."""
