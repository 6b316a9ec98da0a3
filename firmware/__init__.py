"""The ECU loop, written once in the integer subset: the same bytes in CPython, C99, Cortex-M."""
