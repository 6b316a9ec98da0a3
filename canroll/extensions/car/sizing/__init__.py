"""A vehicle from its class and size, and a vehicle beside its class."""
