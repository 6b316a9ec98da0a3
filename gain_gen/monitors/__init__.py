"""What monitors can find: residuals of the linear car, and thresholds from what is not known."""
