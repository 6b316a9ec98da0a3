"""The command ``reproduce``."""
