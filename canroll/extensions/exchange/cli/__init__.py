"""The command ``export-fmu``."""
