"""The integer subset of Python: its sources parsed, its rules checked."""
