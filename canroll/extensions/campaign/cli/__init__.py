"""The commands ``campaign``, ``faults`` and ``attacks``."""
