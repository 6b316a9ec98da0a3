"""Handling of a vehicle, without and with control: tests by driving, and linear response."""
