"""Numba kernels as C99: their typed subset of Python, translated function by function."""
