"""The firmware as it runs: in this process, on an emulated Cortex-M, its records in memory."""

BACKENDS = ("python", "native", "cortex-m0", "cortex-m3", "cortex-m4")
"""Backends that run the firmware."""
