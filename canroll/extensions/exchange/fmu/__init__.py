"""Functional Mock-up Units (FMI 3.0): descriptions, the C that answers importers, archives."""
