"""Checks that know nothing of how a law was found: margins, exact delay, certificates."""
