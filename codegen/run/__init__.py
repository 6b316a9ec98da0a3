"""Execution of the firmware: in this process or on an emulated Cortex-M; its records in memory."""

BACKENDS = ("python", "native", "cortex-m0", "cortex-m3", "cortex-m4")
"""Backends that run the firmware."""
SERVICES = ("xcp", "uds")
"""Modules of the firmware with entry points beside the loop, each an option."""
LASTING = ("nvm", "nvm_uds")
"""Modules that save what outlives a loss of power: of the loop, and of the diagnostics."""
