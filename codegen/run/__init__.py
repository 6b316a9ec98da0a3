"""The firmware as it runs: in this process, on an emulated Cortex-M, its records in memory."""
