"""The simulated bus for other programs: python-can and socketcand."""
