"""A catalogue of faults, driven and judged."""
