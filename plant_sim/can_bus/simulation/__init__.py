"""Response times and ages by simulation."""
