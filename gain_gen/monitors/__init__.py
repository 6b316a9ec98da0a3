"""Design of the monitors: residuals of the linear car, and thresholds from what is not known."""
