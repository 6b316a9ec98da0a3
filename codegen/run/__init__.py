"""Execution of the firmware: in this process or on an emulated Cortex-M; its records in memory."""

BACKENDS = ("python", "native", "cortex-m0", "cortex-m3", "cortex-m4")
"""Backends that run the firmware."""
