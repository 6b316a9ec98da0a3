"""The commands ``vehicle``, ``fit`` and ``validate``."""
