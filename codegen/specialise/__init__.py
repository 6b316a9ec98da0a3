"""Partial evaluation of the firmware for one calibration, as another program of the subset."""
