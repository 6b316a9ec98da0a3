"""A run in real time or lock step: ECU and plant as two programs."""
