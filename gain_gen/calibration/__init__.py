"""Quantisation of a design to integers: rounding error, calibration record and file."""
