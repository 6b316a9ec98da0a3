"""Verification independent of the design method: margins, exact delay, certificates."""
