"""All backends tick by tick on the same traffic."""
