"""The ECU loop, written once in the integer subset: the same bytes in CPython, C99, Cortex-M."""

if __name__ == "firmware":  # not as a second copy, where the checkout is on the path
    raise ImportError("the package is canroll.firmware")
