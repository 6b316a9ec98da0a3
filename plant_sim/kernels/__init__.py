"""Common parts of the kernels: compilation, records as arrays, random numbers."""
