"""Deliverables: the bundle, its headers, A2L and MISRA deviations."""
