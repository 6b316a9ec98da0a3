"""Tyre property files from measured tables: reading, fitting, and what a table cannot tell."""
