"""The commands ``campaign`` and ``faults``."""
