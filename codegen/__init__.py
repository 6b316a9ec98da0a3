"""Firmware to C99: emitter, prover, host library, Cortex-M builds, bundle."""
