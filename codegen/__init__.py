"""Firmware to C99: emitter, prover, host library, Cortex-M builds, bundle."""

if __name__ == "codegen":  # not as a second copy, where the checkout is on the path
    raise ImportError("the package is canroll.codegen")
